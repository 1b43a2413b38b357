"""Signal priority: vehicles request green, and their signals give it within limits.

Transit signal priority as for buses: green extension, early green, recovery.

- A signal serves the earliest request. Vehicles that pass in the same green, as those of a platoon,
  are served with it. A green of an earlier request is not ended for a later one.
- A grant ends when its vehicles have passed or their green is over. Then the signal pauses, so that
  other movements are not starved.
- Recovery, in fixed-time programs: a phase that was ended early gets its time back at its next
  turn, an extended one gives it back; then the program is in step again. Actuated signals need
  none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import libsumo

from slipstream_lab.simulation.signals.detectors import Detectors
from slipstream_lab.simulation.signals.open_requests import OpenRequest
from slipstream_lab.simulation.signals.priority_rules import (
    EndPhase,
    ExtendPhase,
    PrioritySettings,
    decide,
)
from slipstream_lab.simulation.signals.timing import RunningProgram, RunningSignals


@dataclass
class Counts:
    """Counts of requests and grants."""

    requests: int = 0
    served: int = 0
    extensions: int = 0
    early_greens: int = 0


@dataclass
class _Grant:
    """What a signal does for a request."""

    request: OpenRequest
    base_s: dict[float, float] = field(default_factory=dict)
    green: bool = False
    held: bool = False
    cut: bool = False


class Priority:
    """What the signals of the running simulation do about the requests that they have heard.
    `signals`: of the running simulation; changes of their times are reported to it.
    """

    def __init__(self, signals: RunningSignals, settings: PrioritySettings | None = None) -> None:
        self._signals = signals
        self._settings = settings or PrioritySettings()
        self._detectors: dict[str, Detectors] = {}
        self._grants: dict[str, _Grant] = {}
        self._paused_s: dict[str, float] = {}
        self._compensation_s: dict[str, dict[int, float]] = {}
        self._settled_s: dict[str, float] = {}
        self.counts = Counts()

    def step(self, now_s: float, requests: Mapping[str, Sequence[OpenRequest]]) -> None:
        """Before a step: act at the signals."""
        for intersection in [*self._compensation_s]:
            self._settle(intersection, now_s)
        for intersection in sorted({*requests, *self._grants}):
            self._serve(intersection, requests.get(intersection, []), now_s)

    def is_paused(self, intersection: str, now_s: float) -> bool:
        """Whether a signal gives no grant at a time, as it has given one just before."""
        return now_s < self._paused_s.get(intersection, -math.inf)

    def detectors(self, intersection: str) -> Detectors:
        """Of an intersection."""
        known = self._detectors.get(intersection)
        if known is None:
            known = self._detectors[intersection] = Detectors(intersection)
        return known

    def _serve(self, intersection: str, requests: Sequence[OpenRequest], now_s: float) -> None:
        """Act for the requests at one signal."""
        grant = self._grants.get(intersection)
        running = self._signals.running(intersection, now_s)
        if grant is not None and self._is_over(grant, requests, running):
            self._finish(intersection, grant, running, now_s)
            return
        if grant is None:
            if self.is_paused(intersection, now_s):
                return
            chosen = self._first(intersection, running, requests)
            if chosen is None:
                return
            grant = self._grants[intersection] = _Grant(chosen)
        self._act(intersection, grant, requests, running, now_s)

    def _first(
        self, intersection: str, running: RunningProgram, requests: Sequence[OpenRequest]
    ) -> OpenRequest | None:
        """The first request that something can be done for, at no earlier one's cost."""
        phase = running.program.phases[running.phase]
        relied = False
        for request in requests:
            action = self._decide(intersection, running, request, running.end_s)
            if isinstance(action, ExtendPhase) or (isinstance(action, EndPhase) and not relied):
                return request
            relied = relied or phase.allows(request.group)
        return None

    def _decide(
        self, intersection: str, running: RunningProgram, request: OpenRequest, base_s: float
    ) -> ExtendPhase | EndPhase | None:
        settings = self._settings
        queued_s = settings.queue_s * self.detectors(intersection).queue(request.group)
        return decide(
            running.program,
            running.phase,
            running.begun_s,
            base_s,
            request.group,
            request.arrival_s - settings.lead_s - queued_s,
            request.through_s,
            base_s + settings.max_extension_s,
        )

    def _is_over(
        self, grant: _Grant, requests: Sequence[OpenRequest], running: RunningProgram
    ) -> bool:
        """Whether a grant's request has passed, or its green is over."""
        phase = running.program.phases[running.phase]
        if phase.allows(grant.request.group):
            grant.green = True
            return not any(phase.allows(request.group) for request in requests)
        return grant.green or not any(request is grant.request for request in requests)

    def _act(
        self,
        intersection: str,
        grant: _Grant,
        requests: Sequence[OpenRequest],
        running: RunningProgram,
        now_s: float,
    ) -> None:
        phase = running.program.phases[running.phase]
        base_s = grant.base_s.setdefault(running.begun_s, running.end_s)
        if not phase.allows(grant.request.group):
            action = self._decide(intersection, running, grant.request, base_s)
            if (
                isinstance(action, EndPhase)
                and self._may_end_phase(intersection, grant, running)
                and self._end_phase(intersection, running, action.at_s, base_s, now_s)
            ):
                self.counts.early_greens += not grant.cut
                grant.cut = True
                self._count(grant.request)
            return
        end_s = base_s
        for request in requests:
            action = self._decide(intersection, running, request, base_s)
            if isinstance(action, ExtendPhase) and phase.allows(request.group):
                end_s = max(end_s, math.ceil(action.until_s))
                self.counts.extensions += not grant.held
                grant.held = True
                self._count(request)
        if grant.held:
            self._end_at(intersection, running, end_s, now_s)

    def _may_end_phase(self, intersection: str, grant: _Grant, running: RunningProgram) -> bool:
        """Whether the streets that lose green are not full."""
        if grant.cut:
            return True
        phase = running.program.phases[running.phase]
        following = running.program.phases[phase.next[0]]
        detectors = self.detectors(intersection)
        losing = [g for g in detectors.lanes if phase.allows(g) and not following.allows(g)]
        return detectors.count(losing) <= self._settings.max_losing

    def _count(self, request: OpenRequest) -> None:
        self.counts.served += not request.served
        request.served = True

    def _end_phase(
        self, intersection: str, running: RunningProgram, at_s: float, base_s: float, now_s: float
    ) -> bool:
        """End a phase early, as a fixed time to come or, if it is actuated, when it is due."""
        if running.program.fixed:
            self._end_at(intersection, running, min(math.ceil(at_s), base_s), now_s)
            return True
        if at_s > now_s:
            return False
        (following,) = running.program.phases[running.phase].next
        lights = libsumo.trafficlight
        lights.setPhase(intersection, following)
        lights.setPhaseDuration(intersection, running.program.phases[following].min_s)
        self._signals.changed(intersection, {})
        return True

    def _end_at(
        self, intersection: str, running: RunningProgram, end_s: float, now_s: float
    ) -> None:
        """Set the end of the running phase; an actuated one can only be held."""
        end_s = max(end_s, now_s)
        if end_s == running.end_s or (end_s < running.end_s and not running.program.fixed):
            return
        libsumo.trafficlight.setPhaseDuration(intersection, end_s - now_s)
        compensation_s = self._compensation_s.setdefault(intersection, {})
        if running.program.fixed:
            compensation_s[running.phase] = (
                compensation_s.get(running.phase, 0.0) + end_s - running.end_s
            )
            self._settled_s[intersection] = running.begun_s
        if not any(compensation_s.values()):
            del self._compensation_s[intersection]
        self._signals.changed(intersection, compensation_s)

    def _settle(self, intersection: str, now_s: float) -> None:
        """Once a turn of a phase of fixed time, give back what it owes."""
        running = self._signals.running(intersection, now_s)
        phase = running.phase
        if (
            self._settled_s.get(intersection) == running.begun_s
            or running.program.phases[phase].clearing
        ):
            return
        self._settled_s[intersection] = running.begun_s
        lasting_s = running.program.settled_s(
            phase, self._compensation_s[intersection].get(phase, 0.0)
        )
        self._end_at(intersection, running, running.begun_s + lasting_s, now_s)

    def _finish(
        self, intersection: str, grant: _Grant, running: RunningProgram, now_s: float
    ) -> None:
        """End a grant: what it has planned but not done is taken back, then the signal pauses."""
        base_s = grant.base_s.get(running.begun_s)
        if base_s is not None and running.program.fixed:
            self._end_at(intersection, running, base_s, now_s)
        if grant.held or grant.cut:
            pause_s = self._settings.pause_cycles * running.program.cycle_s
            self._paused_s[intersection] = now_s + pause_s
        del self._grants[intersection]
