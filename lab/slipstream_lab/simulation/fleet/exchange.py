"""Messages of a simulated fleet in one process: agents, signals, RSUs, and who else listens.

What a vehicle sends within a step reaches the others within it: radio takes some milliseconds, a
step is half a second. So those behind hear in the same step what those ahead of them announce. A
message with a latency comes with the first step after it.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from slipstream.messages import (
    DriverReport,
    Message,
    PlatoonControl,
    PlatoonManagement,
    SegmentState,
    SignalRequest,
    VehicleAdvice,
    VehiclePlan,
    VehicleSensing,
    spat_key,
)
from slipstream_lab.simulation.signals import SignalController
from vehicle_agent.agent import AgentParameters
from vehicle_agent.host import AgentHost

_PLANS_KEPT: Final = 4


class _LossyHost(AgentHost):
    """Loses a share of the copies of what vehicles send each other, drawn for each receiver."""

    def __init__(
        self,
        vehicles: Mapping[str, AgentParameters],
        stale_after_s: float,
        loss: float,
        seed: int,
    ) -> None:
        super().__init__(vehicles, stale_after_s)
        self._loss, self._rng = loss, random.Random(seed)

    def _addressees(self, message: Message, now_ns: int) -> Iterable[str]:
        names = super()._addressees(message, now_ns)
        if self._loss <= 0 or not isinstance(message, PlatoonControl | PlatoonManagement):
            return names
        return [name for name in names if self._rng.random() >= self._loss]


class Exchange:
    """Agents of a simulated fleet, called directly; see
    `slipstream_lab.simulation.fleet.world.Agents`.

    Args:
        loss: share of the copies of messages between vehicles that are lost.
        latency_s: of such a message.
        seed: of what is lost.
    """

    def __init__(
        self,
        vehicles: Mapping[str, AgentParameters],
        signals: SignalController,
        intersections: Iterable[str],
        time_s: Callable[[], float],
        deliver: Callable[[Message], None],
        stale_after_s: float,
        *,
        loss: float = 0.0,
        latency_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._host = _LossyHost(vehicles, stale_after_s, loss, seed)
        self._latency_ns = round(latency_s * 1e9)
        self._under_way: deque[tuple[int, PlatoonControl | PlatoonManagement]] = deque()
        self._signals, self._time_s, self._deliver = signals, time_s, deliver
        self._spat = {spat_key(name): name for name in intersections}
        self._told: dict[str, object] = {}
        self._plans: dict[str, dict[int, VehiclePlan]] = {name: {} for name in vehicles}
        self._due: set[str] = set()

    @property
    def now_ns(self) -> int:
        """The simulation's present moment, ns since midnight."""
        return round(self._time_s() * 1e9)

    def begin_step(self) -> None:
        """Before each step: signals act on what was asked, and answer; late messages arrive."""
        while self._under_way and self._under_way[0][0] <= self.now_ns:
            self._host.receive(self._under_way.popleft()[1], self.now_ns)
        for status in self._signals.step(self._time_s()):
            self._host.receive(status, self.now_ns)

    def send_plan(self, plan: VehiclePlan) -> None:
        """The dispatcher sends a plan."""
        known = self._plans.get(plan.vehicle)
        if known is None:
            return
        known[plan.cycle] = plan
        while len(known) > _PLANS_KEPT:
            del known[min(known)]
        self._host.receive(plan, self.now_ns)
        self._send_all(plan.vehicle)
        self._due.add(plan.vehicle)

    def send_states(self, states: Iterable[SegmentState]) -> None:
        """The RSUs send what they have seen."""
        for state in states:
            self._host.receive(state, self.now_ns)

    def advise(self, sensing: VehicleSensing) -> VehicleAdvice | None:
        """The advice of a vehicle's agent."""
        now_s = self._time_s()
        self._due.discard(sensing.vehicle)
        for key in self._host.agents[sensing.vehicle].topics():
            intersection = self._spat.get(key)
            if intersection is not None:
                spat = self._signals.spat(intersection, now_s)
                if self._told.get(intersection) is not spat:
                    self._told[intersection] = spat
                    self._host.receive(spat, self.now_ns)
        advice, outgoing = self._host.advise(sensing, self.now_ns)
        for _, message in outgoing:
            self._send(message)
        return advice

    def report(self, report: DriverReport) -> None:
        """A driver says something."""
        self._host.receive(report, self.now_ns)
        self._send_all(report.vehicle)

    def plan(self, vehicle: str, cycle: int) -> VehiclePlan | None:
        """A plan that a vehicle has been sent."""
        return self._plans[vehicle].get(cycle)

    def is_due(self, vehicle: str) -> bool:
        """Whether a vehicle has been sent a plan since it asked last."""
        return vehicle in self._due

    def _send_all(self, vehicle: str) -> None:
        for _, message in self._host.agents[vehicle].take_outgoing():
            self._send(message)

    def _send(self, message: Message) -> None:
        match message:
            case PlatoonControl() | PlatoonManagement() if self._latency_ns:
                self._under_way.append((self.now_ns + self._latency_ns, message))
            case PlatoonControl() | PlatoonManagement():
                self._host.receive(message, self.now_ns)
            case SignalRequest():
                self._signals.receive(message, self._time_s())
            case _:
                self._deliver(message)
