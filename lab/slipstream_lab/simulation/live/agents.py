"""The vehicles of a live world and their agents, over the bus."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection
from typing import Final

from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.messages import (
    ALL_PLANS,
    ALL_STATES,
    DriverReport,
    SegmentState,
    VehicleAdvice,
    VehiclePlan,
    VehicleSensing,
    advice_key,
    decode,
    driver_key,
    sensing_key,
)
from vehicle_agent.roadside import Roadside

_PLANS_KEPT: Final = 4
_STATES_WAITING: Final = 1000


class BusAgents:
    """See `slipstream_lab.simulation.fleet.world.Agents`. The bus's threads write, the
    simulation's reads. `vehicles`: of the world; plans for others are left out.
    """

    def __init__(
        self, bus: Bus, vehicles: Collection[str], clock_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._clock_ns = clock_ns
        self._sensing = {name: bus.publisher(sensing_key(name), history=0) for name in vehicles}
        self._reports = {name: bus.publisher(driver_key(name), history=0) for name in vehicles}
        self._advice: dict[str, VehicleAdvice] = {}
        self._plans: dict[str, dict[int, VehiclePlan]] = {name: {} for name in vehicles}
        self._followed: dict[str, int] = {}
        self._due: set[str] = set()
        bus.subscribe(ALL_PLANS, self._on_plan)
        bus.listener("advice", self._on_advice).listen({advice_key(name) for name in vehicles})

    def advise(self, sensing: VehicleSensing) -> VehicleAdvice | None:
        """Tell what a vehicle senses; the advice to what it sensed before, if it still holds."""
        self._due.discard(sensing.vehicle)
        self._sensing[sensing.vehicle].put(sensing)
        advice = self._advice.get(sensing.vehicle)
        holds = advice is not None and advice.valid_until_ns >= self._clock_ns()
        return advice if holds else None

    def report(self, report: DriverReport) -> None:
        """A driver says something."""
        self._reports[report.vehicle].put(report)

    def plan(self, vehicle: str, cycle: int) -> VehiclePlan | None:
        """A plan that a vehicle has been sent. The one that was asked for last is kept, as it may
        refuse all later ones.
        """
        self._followed[vehicle] = cycle
        return self._plans[vehicle].get(cycle)

    def is_due(self, vehicle: str) -> bool:
        """Whether a vehicle has been sent a plan since it asked last."""
        return vehicle in self._due

    def _on_plan(self, key: str, payload: bytes) -> None:
        try:
            plan = decode(VehiclePlan, payload, key)
        except InputError:
            return
        known = self._plans.get(plan.vehicle)
        if known is not None:
            kept = {**known, plan.cycle: plan}
            newest = {*sorted(kept)[-_PLANS_KEPT:], self._followed.get(plan.vehicle)}
            self._plans[plan.vehicle] = {c: kept[c] for c in sorted(kept) if c in newest}
            self._due.add(plan.vehicle)

    def _on_advice(self, key: str, payload: bytes) -> None:
        try:
            advice = decode(VehicleAdvice, payload, key)
        except InputError:
            return
        self._advice[advice.vehicle] = advice


class BusGates:
    """What RSUs say of the segments, for the drag reductions of vehicles in close gaps.

    The truth is not known here: what an RSU calls turbulent counts as turbulent.
    """

    def __init__(self, bus: Bus, clock_ns: Callable[[], int] = time.time_ns) -> None:
        self._clock_ns = clock_ns
        self._roadside = Roadside()
        self._waiting: deque[SegmentState] = deque(maxlen=_STATES_WAITING)
        bus.subscribe(ALL_STATES, self._on_state, history=False)

    def is_open(self, segment: str) -> bool:
        """Whether a fresh state calls it stable, and none turbulent."""
        self._update()
        return self._roadside.is_open(segment)

    def is_turbulent(self, segment: str) -> bool:
        """Whether a fresh state calls it turbulent."""
        self._update()
        return self._roadside.is_turbulent(segment)

    def _update(self) -> None:
        while self._waiting:
            self._roadside.receive(self._waiting.popleft())
        self._roadside.at(self._clock_ns())

    def _on_state(self, key: str, payload: bytes) -> None:
        try:
            self._waiting.append(decode(SegmentState, payload, key))
        except InputError:
            return
