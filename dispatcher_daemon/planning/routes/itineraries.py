"""A vehicle's route with its times: one option of the route form, x_{k,r}."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

from dispatcher_daemon.fleet import Commitment, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.platooning import MeetingBook, Traversals
from dispatcher_daemon.planning.roads import (
    RoadLeg,
    Route,
    Travel,
    lateness_by_window_s,
    lateness_s,
    timed,
)
from dispatcher_daemon.planning.routes.breaks import with_breaks
from dispatcher_daemon.planning.routes.charging_stops import Batteries
from dispatcher_daemon.planning.routes.continuing import committed_legs
from dispatcher_daemon.planning.routes.windows import Windows
from dispatcher_daemon.traffic import TrafficSnapshot

S_PER_H: Final = 3600.0
_ROUNDING_S: Final = 1e-6


@dataclass(frozen=True)
class Itinerary:
    """One vehicle's exact route, its cost without platooning, and its passages of open segments.

    Attributes:
        stops: served in order; none: the vehicle stays idle.
        route: with its timetable; None for an idle vehicle.
        cost_kwh: Σ leg costs without platooning, and the cost of waiting for other vehicles.
        traversals: passages of segments whose gate is open, or may be then.
    """

    number: int
    stops: tuple[str, ...]
    route: Route | None
    cost_kwh: float
    traversals: Traversals

    @cached_property
    def key(self) -> tuple[object, ...]:
        """The same for itineraries that are the same to a tenth of a second."""
        paths = () if self.route is None else tuple(leg.path for leg in self.route.legs)
        waits_s = tuple(round(wait_s, 1) for wait_s in self.waits_s)
        return self.number, self.stops, paths, round(self.depart_s, 1), waits_s

    @property
    def depart_s(self) -> float:
        """When it leaves its depot."""
        return 0.0 if self.route is None else self.route.visits[0].departure_s

    @property
    def waits_s(self) -> tuple[float, ...]:
        """How long it waits for other vehicles at the end of each leg but the last."""
        return () if self.route is None else tuple(v.wait_s for v in self.route.visits[1:-1])


class Planner:
    """Makes itineraries of one fleet under one traffic snapshot.

    Attributes:
        travels: paths between places; the first are those of least energy, others alternatives.
        paths_per_leg: number of cheapest paths of each leg that options may contain.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        snapshot: TrafficSnapshot,
        travels: Sequence[Travel],
        sync_window_s: float,
        reference_s: float = 0.0,
        paths_per_leg: int = 1,
        on_road: Sequence[RoadUser] = (),
        commitments: Sequence[Commitment] = (),
    ) -> None:
        self.paths_per_leg = paths_per_leg
        self.problem, self.snapshot = problem, snapshot
        self.travels = tuple(travels)
        self.book = MeetingBook(problem, snapshot, sync_window_s, on_road, commitments)
        now_ns = snapshot.now_ns
        self.windows = Windows(problem, now_ns, self.travels, reference_s, commitments)
        self.batteries = Batteries(problem)
        self._committed: dict[tuple[int, int], list[RoadLeg] | None] = {}

    @classmethod
    def of(cls, cycle: Cycle, travels: Sequence[Travel]) -> Planner:
        """For a cycle, with its vehicles on the road."""
        return cls(
            cycle.problem,
            cycle.snapshot,
            travels,
            cycle.settings.sync_window_s,
            cycle.reference_s,
            on_road=cycle.on_road,
            commitments=cycle.commitments,
        )

    def legs(self, number: int, stops: Sequence[str], travel: int = 0) -> list[RoadLeg] | None:
        """Legs of a route with charging stops and breaks; None: no path, or too little charge."""
        fleet = self.problem.fleet
        vehicle = fleet.vehicles[number]
        depot, own = fleet.depot_of(vehicle).id, self.travels[travel].of(vehicle)
        fixed = self.fixed_legs(number, travel)
        if fixed is None:
            return None
        legs = list(fixed)
        for start, end in list(pairwise((depot, *stops, depot)))[len(fixed) :]:
            leg = own.leg(start, end)
            if leg is None:
                return None
            legs.append(leg)
        bound = number in self.windows.bound
        found = self.batteries.with_stops(number, own, legs, len(fixed), under_way=bound)
        if found is None or bound or not vehicle.breaks:
            return found
        return with_breaks(self.problem, vehicle, found, self.windows.reference_s)

    def lasts(self, number: int, legs: Sequence[RoadLeg]) -> bool:
        """Whether a vehicle's battery lasts for a route, charged at its depot if need be."""
        return math.isfinite(self.ready_after_charging_s(number, legs))

    def ready_after_charging_s(self, number: int, legs: Sequence[RoadLeg]) -> float:
        """When a vehicle can leave at the earliest, s; inf: its battery does not last."""
        return self.windows.of(number)[0] + S_PER_H * self.batteries.needed_h(number, legs)

    def fixed_legs(self, number: int, travel: int = 0) -> list[RoadLeg] | None:
        """The first legs of a bound vehicle, none of any other one; None: no way leads on."""
        own = self.windows.bound.get(number)
        if own is None:
            return []
        if (number, travel) not in self._committed:
            vehicle = self.problem.fleet.vehicles[number]
            of = self.travels[travel].of(vehicle)
            legs = committed_legs(self.problem, of, own, vehicle)
            self._committed[number, travel] = legs
        return self._committed[number, travel]

    def idle(self, number: int) -> Itinerary:
        """The vehicle stays at its depot."""
        return Itinerary(number, (), None, 0.0, {})

    def itinerary(
        self,
        number: int,
        stops: tuple[str, ...],
        legs: Sequence[RoadLeg] | None,
        depart_s: float | None = None,
        waits_s: Sequence[float] = (),
    ) -> Itinerary | None:
        """A vehicle's itinerary over given legs; None if a window is missed, a path missing, or the
        charge falls below the reserve.

        Args:
            depart_s: None: as soon as it is ready and charged. A bound vehicle goes on as it can.
            waits_s: for other vehicles, at the end of each leg but the last; none: nowhere.
        """
        bound = number in self.windows.bound
        if not stops and not bound:
            return self.idle(number)
        if legs is None:
            return None
        if bound:
            return self._bound_itinerary(number, stops, legs, depart_s, waits_s)
        vehicle = self.problem.fleet.vehicles[number]
        earliest_s = self.ready_after_charging_s(number, legs)
        if math.isinf(earliest_s) or (depart_s is not None and depart_s < earliest_s - _ROUNDING_S):
            return None
        depart_s = earliest_s if depart_s is None else depart_s
        route = timed(self.problem, legs, vehicle, self.windows.reference_s, depart_s, waits_s)
        # A departure computed from a meeting may miss its window by rounding.
        if lateness_s(self.problem, vehicle, route, self.windows.reference_s) > _ROUNDING_S:
            return None
        at_depot_s = route.visits[0].departure_s - self.windows.of(number)[0]
        return self._itinerary(number, stops, route, max(0.0, at_depot_s))

    def _bound_itinerary(
        self,
        number: int,
        stops: tuple[str, ...],
        legs: Sequence[RoadLeg],
        depart_s: float | None,
        waits_s: Sequence[float],
    ) -> Itinerary | None:
        """What a bound vehicle has loaded is delivered, late or not, but later for no wait."""
        problem, vehicle = self.problem, self.problem.fleet.vehicles[number]
        first_s, last_s = self.windows.of(number)
        begins_s = first_s if depart_s is None else min(max(depart_s, first_s), last_s)

        def driven(begins_s: float, waits_s: Sequence[float]) -> Route:
            route = timed(problem, legs, vehicle, self.windows.reference_s, begins_s, waits_s)
            return self.windows.standing_first(number, route)

        def late_s(route: Route) -> list[float]:
            return lateness_by_window_s(
                problem, vehicle, route, self.windows.reference_s, under_way=True
            )

        # It waits as planned before a leg that is fixed.
        fixed = max(0, len(self.fixed_legs(number) or ()) - 1)
        planned_s = (
            self.windows.planned_waits_s(number, driven(first_s, ()))[:fixed] if fixed else ()
        )
        at_once = driven(first_s, planned_s)
        waits_s = (*planned_s, *waits_s[fixed:])
        if begins_s == first_s and not any(waits_s[fixed:]):
            return self._itinerary(number, stops, at_once, 0.0)
        route = driven(begins_s, waits_s)
        for late, allowed in zip(late_s(route), late_s(at_once), strict=True):
            if late > max(0.0, allowed) + _ROUNDING_S:
                return None
        return self._itinerary(number, stops, route, 0.0)

    def _itinerary(
        self, number: int, stops: tuple[str, ...], route: Route, at_depot_s: float
    ) -> Itinerary:
        problem = self.problem
        cost = sum(leg.cost_kwh for leg in route.legs)
        cost += problem.price_of_waiting_kw * at_depot_s / S_PER_H
        for visit in route.visits:
            if visit.wait_s:
                cost += problem.price_of_wait_kw(visit.place) * visit.wait_s / S_PER_H
        return Itinerary(number, stops, route, cost, self.book.traversals(number, route))
