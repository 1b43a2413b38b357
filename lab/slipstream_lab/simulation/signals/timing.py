"""The signal programs of the running simulation as they run, each read once a step at most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import libsumo

from slipstream.messages import SignalPhaseAndTiming
from slipstream_lab.simulation.signals.program import NO_COMPENSATION, Phase, Program
from slipstream_lab.simulation.signals.spat import movement_states

_STATIC: Final = 0
"""SUMO's number of the type of programs with fixed times."""

_REPEAT_NS: Final = 1_000_000_000
"""A message whose content holds is sent again after this time."""


@dataclass
class RunningProgram:
    """What a signal does now.

    Attributes:
        end_s: when it ends; at the earliest, if it is actuated.
        message: what was told of it last; None: nothing since it changed.
    """

    program: Program
    phase: int
    begun_s: float
    end_s: float
    read_s: float
    name: str
    message: SignalPhaseAndTiming | None = None


class RunningSignals:
    """The signals of the running simulation. `min_green_s`: what a green of fixed time keeps when
    it is shortened; less if it is shorter.
    """

    def __init__(self, min_green_s: float = 8.0) -> None:
        self._min_green_s = min_green_s
        self._programs: dict[tuple[str, str], Program] = {}
        self._running: dict[str, RunningProgram] = {}
        self._compensation_s: dict[str, Mapping[int, float]] = {}
        self._revisions: dict[str, int] = {}

    def spat(self, intersection: str, now_s: float) -> SignalPhaseAndTiming:
        """What a signal tells at a time, which must be the simulation's.

        The same object while nothing has changed and it is younger than a second; then a copy of a
        new date with the same `movements`. A phase that has reached its earliest end and goes on is
        told anew at each time.
        """
        running = self.running(intersection, now_s)
        now_ns = round(now_s * 1e9)
        known = running.message
        if known is None:
            revision = self._revisions[intersection] = self._revisions.get(intersection, -1) + 1
            compensation_s = self._compensation_s.get(intersection, NO_COMPENSATION)
            known = running.message = SignalPhaseAndTiming(
                intersection=intersection,
                revision=revision,
                time_ns=now_ns,
                movements=movement_states(
                    running.program, running.phase, running.begun_s, running.end_s, compensation_s
                ),
            )
        elif now_ns > known.time_ns and (
            now_s >= running.end_s or now_ns >= known.time_ns + _REPEAT_NS
        ):
            known = running.message = known.model_copy(update={"time_ns": now_ns})
        return known

    def running(self, intersection: str, now_s: float) -> RunningProgram:
        """What a signal does at a time, which must be the simulation's."""
        known = self._running.get(intersection)
        if known is not None and known.read_s == now_s:
            return known
        lights = libsumo.trafficlight
        name, phase = lights.getProgram(intersection), lights.getPhase(intersection)
        end_s = lights.getNextSwitch(intersection)
        if known is not None and (known.name, known.phase, known.end_s) == (name, phase, end_s):
            known.read_s = now_s
            return known
        begun_s = now_s - lights.getSpentDuration(intersection)
        known = RunningProgram(
            self._program(intersection, name), phase, begun_s, end_s, now_s, name
        )
        self._running[intersection] = known
        return known

    def changed(self, intersection: str, compensation_s: Mapping[int, float]) -> None:
        """Take in a change of a signal's times. `compensation_s`: what its phases owe now; see
        `Program.course`.
        """
        self._running.pop(intersection, None)
        self._compensation_s[intersection] = dict(compensation_s)

    def _program(self, intersection: str, name: str) -> Program:
        known = self._programs.get((intersection, name))
        if known is None:
            logics = libsumo.trafficlight.getAllProgramLogics(intersection)
            known = self._read(next(logic for logic in logics if logic.programID == name))
            self._programs[intersection, name] = known
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
