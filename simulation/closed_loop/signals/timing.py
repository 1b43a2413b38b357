"""What an RSU broadcasts of a signal of the running simulation: when it will be green.

Programs of fixed times are known; of actuated ones an RSU knows the phase, how long it will last at
least, and which phases must pass before another one comes (as SAE J2735's SPaT message says by
minEndTime).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import libsumo

from simulation.closed_loop.signals.program import Green, Phase, Program

__all__ = ["Green", "Running", "Signals"]

_STATIC: Final = 0
"""SUMO's number of the type of programs with fixed times."""


@dataclass
class Running:
    """What a signal does now.

    Attributes:
        program: that it runs.
        phase: number of its phase.
        begun_s: when that phase began.
        end_s: when it ends; at the earliest, if it is actuated.
        lag_s: how far that is behind the program's usual time; 0 where none is fixed.
    """

    program: Program
    phase: int
    begun_s: float
    end_s: float
    lag_s: float
    read_s: float
    name: str
    greens: dict[int, tuple[Green, ...]] = field(default_factory=dict)


class Signals:
    """The signals of the running simulation, each read once a step at most.

    Args:
        least_green_s: what a green of fixed time keeps when it is shortened; less if it is shorter.
    """

    def __init__(self, least_green_s: float = 8.0) -> None:
        self._least_green_s = least_green_s
        self._programs: dict[tuple[str, str], tuple[Program, float]] = {}
        self._running: dict[str, Running] = {}

    def upcoming(self, tls: str, link: int, now_s: float) -> tuple[Green, ...]:
        """When a movement may go, soonest first, from now on.

        Fixed times: the greens of the next two cycles. Actuated: the running green and its earliest
        end, or the next one from its earliest begin on. Empty if the program leaves it open.

        Args:
            tls: the signal.
            link: number of the movement at the signal.
            now_s: simulated time.
        """
        running = self.running(tls, now_s)
        greens = running.greens.get(link)
        if greens is None:
            greens = running.program.greens(
                link, running.phase, running.begun_s, running.end_s, running.lag_s
            )
            running.greens[link] = greens
        return greens

    def running(self, tls: str, now_s: float) -> Running:
        """What a signal does at a time, which must be the simulation's."""
        known = self._running.get(tls)
        if known is not None and known.read_s == now_s:
            return known
        lights = libsumo.trafficlight
        name, phase, end_s = lights.getProgram(tls), lights.getPhase(tls), lights.getNextSwitch(tls)
        if known is not None and (known.name, known.phase, known.end_s) == (name, phase, end_s):
            known.read_s = now_s
            return known
        program, anchor_s = self._program(tls, name, phase, end_s)
        begun_s = now_s - lights.getSpentDuration(tls)
        lag_s = 0.0
        if program.fixed:
            cycle_s = program.cycle_s
            lag_s = (end_s - anchor_s - program.usual_end_s(phase)) % cycle_s
            lag_s -= cycle_s if lag_s > cycle_s / 2 else 0.0
        known = Running(program, phase, begun_s, end_s, lag_s, now_s, name)
        self._running[tls] = known
        return known

    def forget(self, tls: str) -> None:
        """Read a signal anew, because it was changed within the step."""
        self._running.pop(tls, None)

    def _program(self, tls: str, name: str, phase: int, end_s: float) -> tuple[Program, float]:
        """A program, and when one of its cycles began; read first before anybody changes it."""
        known = self._programs.get((tls, name))
        if known is None:
            logics = libsumo.trafficlight.getAllProgramLogics(tls)
            program = self._read(next(logic for logic in logics if logic.programID == name))
            known = program, end_s - program.usual_end_s(phase)
            self._programs[tls, name] = known
        return known

    def _read(self, logic: Any) -> Program:
        fixed = logic.type == _STATIC
        count = len(logic.phases)
        phases = []
        for number, read in enumerate(logic.phases):
            usual_s = float(read.duration)
            phase = Phase(
                read.state,
                usual_s,
                usual_s if fixed else float(read.minDur),
                usual_s if fixed else float(read.maxDur),
                tuple(read.next) or ((number + 1) % count,),
            )
            if fixed and not phase.clearing:
                least_s = min(usual_s, self._least_green_s)
                phase = Phase(phase.state, usual_s, least_s, usual_s, phase.next)
            phases.append(phase)
        return Program(tuple(phases), fixed)
