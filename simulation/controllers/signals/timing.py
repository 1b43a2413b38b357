"""What an RSU broadcasts of a signal of the running simulation: when it will be green.

Programs of fixed times are known; of actuated ones an RSU knows the phase, how long it will last at
least, and which phases must pass before another one comes (as SAE J2735's SPaT message says by
minEndTime).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import libsumo

from simulation.controllers.signals.program import NO_COMPENSATION, Green, Phase, Program

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
        read_s: when this was read.
        name: of the program.
        greens: what is known of its movements so far.
    """

    program: Program
    phase: int
    begun_s: float
    end_s: float
    read_s: float
    name: str
    greens: dict[int, tuple[Green, ...]] = field(default_factory=dict)


class Signals:
    """The signals of the running simulation, each read once a step at most.

    Args:
        min_green_s: what a green of fixed time keeps when it is shortened; less if it is shorter.
    """

    def __init__(self, min_green_s: float = 8.0) -> None:
        self._min_green_s = min_green_s
        self._programs: dict[tuple[str, str], Program] = {}
        self._running: dict[str, Running] = {}
        self._compensation_s: dict[str, Mapping[int, float]] = {}

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
                link,
                running.phase,
                running.begun_s,
                running.end_s,
                self._compensation_s.get(tls, NO_COMPENSATION),
            )
            running.greens[link] = greens
        return greens

    def predicted(self, tls: str, link: int, now_s: float, ahead_s: float) -> tuple[Green, ...]:
        """`upcoming`, as far ahead as asked where times are fixed."""
        running = self.running(tls, now_s)
        if not running.program.fixed:
            return self.upcoming(tls, link, now_s)
        compensation_s = self._compensation_s.get(tls, NO_COMPENSATION)
        return running.program.greens(
            link, running.phase, running.begun_s, running.end_s, compensation_s, ahead_s
        )

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
        begun_s = now_s - lights.getSpentDuration(tls)
        known = Running(self._program(tls, name), phase, begun_s, end_s, now_s, name)
        self._running[tls] = known
        return known

    def changed(self, tls: str, compensation_s: Mapping[int, float]) -> None:
        """Take in a change of a signal's times.

        Args:
            tls: the signal.
            compensation_s: what its phases owe now; see `Program.greens`.
        """
        self._running.pop(tls, None)
        self._compensation_s[tls] = dict(compensation_s)

    def _program(self, tls: str, name: str) -> Program:
        known = self._programs.get((tls, name))
        if known is None:
            logics = libsumo.trafficlight.getAllProgramLogics(tls)
            known = self._read(next(logic for logic in logics if logic.programID == name))
            self._programs[tls, name] = known
        return known

    def _read(self, logic: Any) -> Program:
        fixed = logic.type == _STATIC
        count = len(logic.phases)
        phases = []
        for number, read in enumerate(logic.phases):
            nominal_s = float(read.duration)
            min_s = nominal_s if fixed else float(read.minDur)
            phase = Phase(read.state, nominal_s, min_s, tuple(read.next) or ((number + 1) % count,))
            if fixed and not phase.clearing:
                phase = replace(phase, min_s=min(nominal_s, self._min_green_s))
            phases.append(phase)
        return Program(tuple(phases), fixed)
