"""Signal priority: vehicles near a signal request green, within limits.

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
from typing import Final

import libsumo

from simulation.controllers.signals.crossings import Movements
from simulation.controllers.signals.priority_requests import PriorityRequests, Request
from simulation.controllers.signals.priority_rules import (
    EndPhase,
    ExtendPhase,
    PrioritySettings,
    decide,
)
from simulation.controllers.signals.timing import Running, Signals
from simulation.controllers.vehicle import LegOrder, VehicleState

_NONE: Final[Mapping[str, float]] = {}


@dataclass
class Counts:
    """Counts of requests and grants.

    Attributes:
        requests: vehicles at signals that asked.
        served: of them, those that something was done for.
        extensions: grants that extended a green.
        early_greens: grants that cut a phase.
    """

    requests: int = 0
    served: int = 0
    extensions: int = 0
    early_greens: int = 0


@dataclass
class _Grant:
    """What a signal does for a request.

    Attributes:
        request: the first one that it was given for.
        base_s: by the begin of a phase, when it would have ended without the grant.
        green: whether the movement has had green since.
        held: whether a green was extended for it.
        cut: whether a phase was cut for it.
    """

    request: Request
    base_s: dict[float, float] = field(default_factory=dict)
    green: bool = False
    held: bool = False
    cut: bool = False


class Priority:
    """Requests of the fleet's vehicles, and what signals do about them.

    Args:
        signals: of the running simulation; changes of their times are reported to it.
        enabled: whether the city gives priority at all.
        settings: how.
    """

    def __init__(
        self, signals: Signals, enabled: bool, settings: PrioritySettings | None = None
    ) -> None:
        self._signals = signals
        self._enabled = enabled
        self._settings = settings or PrioritySettings()
        self._movements: Movements | None = None
        self._asking: PriorityRequests | None = None
        self._grants: dict[str, _Grant] = {}
        self._paused_s: dict[str, float] = {}
        self._compensation_s: dict[str, dict[int, float]] = {}
        self._settled_s: dict[str, float] = {}
        self._next_s = -math.inf
        self.counts = Counts()

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle that may ask came onto the road, or was given another way on it."""
        if self._enabled:
            if self._movements is None or self._asking is None:
                self._movements = Movements()
                self._asking = PriorityRequests(self._signals, self._movements, self._settings)
            self._asking.departed(name, order)

    def ended(self, name: str) -> None:
        """A vehicle is off the road."""
        if self._asking is not None:
            self._asking.ended(name)

    def step(
        self,
        now_s: float,
        states: Mapping[str, VehicleState],
        tails_m: Mapping[str, float] = _NONE,
    ) -> None:
        """Before each step: once a second, hear the vehicles, then act at the signals.

        Args:
            now_s: simulated time.
            states: of the vehicles on the road after the last step.
            tails_m: from a leader's front to the end of its platoon.
        """
        if self._asking is None or now_s < self._next_s:
            return
        self._next_s = math.floor(now_s) + 1.0
        requests = self._asking.at_signals(now_s, states, tails_m)
        self.counts.requests += sum(
            r.first_s == now_s for group in requests.values() for r in group
        )
        for tls in [*self._compensation_s]:
            self._settle(tls, now_s)
        for tls in sorted({*requests, *self._grants}):
            self._serve(tls, requests.get(tls, []), now_s)

    def _serve(self, tls: str, requests: Sequence[Request], now_s: float) -> None:
        """Act for the requests at one signal."""
        grant = self._grants.get(tls)
        running = self._signals.running(tls, now_s)
        if grant is not None and self._is_over(grant, requests, running):
            self._finish(tls, grant, running, now_s)
            return
        if grant is None:
            if now_s < self._paused_s.get(tls, -math.inf):
                return
            chosen = self._first(running, requests)
            if chosen is None:
                return
            grant = self._grants[tls] = _Grant(chosen)
        self._act(tls, grant, requests, running, now_s)

    def _first(self, running: Running, requests: Sequence[Request]) -> Request | None:
        """The first request that something can be done for, at no earlier one's cost."""
        phase = running.program.phases[running.phase]
        relied = False
        for request in requests:
            action = self._decide(running, request, running.end_s)
            if isinstance(action, ExtendPhase) or (isinstance(action, EndPhase) and not relied):
                return request
            relied = relied or phase.allows(request.link)
        return None

    def _decide(
        self, running: Running, request: Request, base_s: float
    ) -> ExtendPhase | EndPhase | None:
        return decide(
            running.program,
            running.phase,
            running.begun_s,
            base_s,
            request.link,
            request.wanted_s,
            request.through_s,
            base_s + self._settings.max_extension_s,
        )

    def _is_over(self, grant: _Grant, requests: Sequence[Request], running: Running) -> bool:
        """Whether a grant's request has passed, or its green is over."""
        phase = running.program.phases[running.phase]
        if phase.allows(grant.request.link):
            grant.green = True
            return not any(phase.allows(request.link) for request in requests)
        return grant.green or not any(request is grant.request for request in requests)

    def _act(
        self, tls: str, grant: _Grant, requests: Sequence[Request], running: Running, now_s: float
    ) -> None:
        phase = running.program.phases[running.phase]
        base_s = grant.base_s.setdefault(running.begun_s, running.end_s)
        if not phase.allows(grant.request.link):
            action = self._decide(running, grant.request, base_s)
            if (
                isinstance(action, EndPhase)
                and self._may_end_phase(tls, grant, running)
                and self._end_phase(tls, running, action.at_s, base_s, now_s)
            ):
                self.counts.early_greens += not grant.cut
                grant.cut = True
                self._count(grant.request)
            return
        end_s = base_s
        for request in requests:
            action = self._decide(running, request, base_s)
            if isinstance(action, ExtendPhase) and phase.allows(request.link):
                end_s = max(end_s, math.ceil(action.until_s))
                self.counts.extensions += not grant.held
                grant.held = True
                self._count(request)
        if grant.held:
            self._end_at(tls, running, end_s, now_s)

    def _may_end_phase(self, tls: str, grant: _Grant, running: Running) -> bool:
        """Whether the streets that lose green are not full."""
        if grant.cut or self._movements is None:
            return True
        phase = running.program.phases[running.phase]
        following = running.program.phases[phase.next[0]]
        losing = {
            name
            for link, names in self._movements.lanes(tls).items()
            if phase.allows(link) and not following.allows(link)
            for name in names
        }
        count: int = sum(libsumo.lane.getLastStepVehicleNumber(name) for name in sorted(losing))
        return count <= self._settings.max_losing

    def _count(self, request: Request) -> None:
        self.counts.served += not request.served
        request.served = True

    def _end_phase(
        self, tls: str, running: Running, at_s: float, base_s: float, now_s: float
    ) -> bool:
        """End a phase early, as a fixed time to come or, if it is actuated, when it is due."""
        if running.program.fixed:
            self._end_at(tls, running, min(math.ceil(at_s), base_s), now_s)
            return True
        if at_s > now_s:
            return False
        (following,) = running.program.phases[running.phase].next
        lights = libsumo.trafficlight
        lights.setPhase(tls, following)
        lights.setPhaseDuration(tls, running.program.phases[following].min_s)
        self._signals.changed(tls, {})
        return True

    def _end_at(self, tls: str, running: Running, end_s: float, now_s: float) -> None:
        """Set the end of the running phase; an actuated one can only be held."""
        end_s = max(end_s, now_s)
        if end_s == running.end_s or (end_s < running.end_s and not running.program.fixed):
            return
        libsumo.trafficlight.setPhaseDuration(tls, end_s - now_s)
        compensation_s = self._compensation_s.setdefault(tls, {})
        if running.program.fixed:
            compensation_s[running.phase] = (
                compensation_s.get(running.phase, 0.0) + end_s - running.end_s
            )
            self._settled_s[tls] = running.begun_s
        if not any(compensation_s.values()):
            del self._compensation_s[tls]
        self._signals.changed(tls, compensation_s)

    def _settle(self, tls: str, now_s: float) -> None:
        """Once a turn of a phase of fixed time, give back what it owes."""
        running = self._signals.running(tls, now_s)
        phase = running.phase
        if self._settled_s.get(tls) == running.begun_s or running.program.phases[phase].clearing:
            return
        self._settled_s[tls] = running.begun_s
        lasting_s = running.program.settled_s(phase, self._compensation_s[tls].get(phase, 0.0))
        self._end_at(tls, running, running.begun_s + lasting_s, now_s)

    def _finish(self, tls: str, grant: _Grant, running: Running, now_s: float) -> None:
        """End a grant: what it has planned but not done is taken back, then the signal pauses."""
        base_s = grant.base_s.get(running.begun_s)
        if base_s is not None and running.program.fixed:
            self._end_at(tls, running, base_s, now_s)
        if grant.held or grant.cut:
            pause_s = self._settings.pause_cycles * running.program.cycle_s
            self._paused_s[tls] = now_s + pause_s
        del self._grants[tls]
