"""The fleet's day: vehicles on their tours, and the next leg of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.messages import PlannedSegment, VehiclePlan
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.closed_loop.record import OrderService
from slipstream_lab.simulation.exogenous.passages import RecordedLeg
from slipstream_lab.simulation.scenarios.demand import Deliveries, Order


@dataclass(frozen=True)
class LegOrder:
    """One leg as its vehicle is to drive it.

    Attributes:
        round: number of the tour in the vehicle's day, from 0.
        path: segments, the first one left from its beginning, the last one driven to its end.
        ready_s: from when on it could have left, s since midnight; travel time counts from then.
    """

    vehicle: str
    round: int
    leg: int
    path: tuple[str, ...]
    ready_s: float
    due_s: float
    free_s: float

    @property
    def id(self) -> str:
        """Its name."""
        return f"{self.vehicle}/{self.round}/{self.leg}"


@dataclass
class _Tour:
    """A vehicle's tour: its plan by legs, and its present leg."""

    number: int
    plan: VehiclePlan
    legs: tuple[tuple[PlannedSegment, ...], ...]
    leg: int = 0
    late_s: float = 0.0


@dataclass
class Tours:
    """Vehicles idle and under way, orders taken and served. `idle`: when each vehicle is ready at
    its depot, s since midnight; those under way are left out.
    """

    deliveries: Deliveries
    network: RoadNetwork
    idle: dict[str, float] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.idle = dict.fromkeys(self.deliveries.vehicles, 0.0)
        self._orders: Mapping[str, Order] = {order.id: order for order in self.deliveries.orders}
        self._under_way: dict[str, _Tour] = {}
        self._begun = dict.fromkeys(self.deliveries.vehicles, 0)
        self._served: dict[str, float] = {}

    def keep_released(self, begin_s: float, end_s: float) -> None:
        """Leave out orders that are not released within a part of the day."""
        self._orders = {n: o for n, o in self._orders.items() if begin_s <= o.release_s < end_s}
        self.taken.update(o.id for o in self.deliveries.orders if o.id not in self._orders)

    @property
    def open(self) -> bool:
        """Whether an order is on no tour yet."""
        return not self._orders.keys() <= self.taken

    def begin(self, plan: VehiclePlan) -> Iterator[LegOrder]:
        """A vehicle starts a tour; its first leg."""
        count = len(plan.stops) - 1
        legs = tuple(tuple(s for s in plan.segments if s.leg == leg) for leg in range(count))
        del self.idle[plan.vehicle]
        self.taken.update(stop.stop for stop in plan.stops[1:-1])
        self._under_way[plan.vehicle] = _Tour(self._begun[plan.vehicle], plan, legs)
        self._begun[plan.vehicle] += 1
        yield from self._next(plan.vehicle, plan.issued_ns / 1e9, plan.depart_ns / 1e9)

    def arrived(self, leg: RecordedLeg) -> Iterator[LegOrder]:
        """A vehicle ended a leg; the next one, none at its depot."""
        self._under_way[leg.vehicle].leg = leg.leg
        yield from self._serve(leg.vehicle, leg.arrived_s)

    def plans(self) -> tuple[VehiclePlan, ...]:
        """Plans of the vehicles under way."""
        return tuple(own.plan for own in self._under_way.values())

    def late_s(self) -> dict[str, float]:
        """By how much each vehicle under way began its present leg later than planned."""
        return {name: own.late_s for name, own in self._under_way.items()}

    def services(self, end_s: float) -> tuple[OrderService, ...]:
        """One an order that was released before the end."""
        return tuple(
            OrderService(order.id, order.latest_s, self._served.get(order.id))
            for order in self._orders.values()
            if order.release_s < end_s
        )

    def _serve(self, vehicle: str, now_s: float) -> Iterator[LegOrder]:
        """At the place that the present leg ends at."""
        own = self._under_way[vehicle]
        own.leg += 1
        if own.leg == len(own.legs):
            del self._under_way[vehicle]
            self.idle[vehicle] = now_s
            return
        stop = own.plan.stops[own.leg]
        if stop.kind == "break":
            ended_s = max(now_s + stop.break_s, stop.departure_ns / 1e9)
            yield from self._next(vehicle, ended_s, ended_s)
            return
        order = self._orders[stop.stop]
        self._served[order.id] = now_s
        done_s = now_s + order.service_s
        yield from self._next(vehicle, done_s, done_s)

    def _next(self, vehicle: str, ready_s: float, due_s: float) -> Iterator[LegOrder]:
        own = self._under_way[vehicle]
        planned = own.legs[own.leg]
        if not planned:  # two places at one junction
            yield from self._serve(vehicle, due_s)
            return
        own.late_s = due_s - own.plan.stops[own.leg].departure_ns / 1e9
        path = tuple(segment.segment for segment in planned)
        yield LegOrder(
            vehicle,
            own.number,
            own.leg,
            path,
            ready_s,
            due_s,
            free_s(self.network, path),
        )


def free_s(network: RoadNetwork, path: tuple[str, ...]) -> float:
    """Time of a path from rest to rest at the limit on empty roads, s."""
    segments = [network.segments[name] for name in path]
    return plan_drive(
        [s.length_m for s in segments], [s.speed_limit_mps for s in segments], DrivingStyle()
    ).duration_s
