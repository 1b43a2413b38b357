"""A vehicle's route with its times: one option of the route form, x_{k,r}."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

from dispatcher_daemon.fleet import Commitment, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning import (
    Meetings,
    OpenPassages,
    Shares,
    Traversals,
    counted_drafting,
    open_shares,
    traversals_on_road,
)
from dispatcher_daemon.planning.roads import (
    Leg,
    Route,
    Travel,
    lateness_by_window_s,
    lateness_s,
    timed,
)
from dispatcher_daemon.planning.routes.breaks import with_breaks
from dispatcher_daemon.planning.routes.charging_stops import Batteries
from dispatcher_daemon.planning.routes.continuing import (
    committed_legs,
    departure_s,
    planned_waits_s,
)
from dispatcher_daemon.traffic import TrafficSnapshot

S_PER_H: Final = 3600.0
_ROUNDING_S: Final = 1e-6
MAX_WAIT_S: Final = 600.0
"""Longest wait at one stop: nobody foresees traffic much further."""


@dataclass(frozen=True)
class Itinerary:
    """One vehicle's exact route, its cost without platooning, and its passages of open segments.

    Attributes:
        number: of the vehicle in the fleet.
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
        shares: saving of a leader and of a follower of the fleet's first profile on each open
            segment.
        shares_by_profile: those of all its profiles.
        expected: of platoons; None: they are close everywhere.
        sync_window_s: Δt_sync.
        reference_s: when a vehicle that is ready at once leaves.
        paths_per_leg: number of cheapest paths of each leg that options may contain.
        batteries: what they allow.
        on_road: passages of open segments by vehicles that earlier cycles sent; they stay as they
            are.
        bound: commitments by the numbers of their vehicles.
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
        self.sync_window_s = sync_window_s
        self.travels = tuple(travels)
        first, *others = problem.profiles
        self.shares: Mapping[str, Shares] = open_shares(problem, snapshot, first)
        self.shares_by_profile = {
            first: self.shares,
            **{other: open_shares(problem, snapshot, other) for other in others},
        }
        self.reference_s = reference_s
        self.batteries = Batteries(problem)
        self.expected = counted_drafting(problem, snapshot, commitments, on_road)
        self._passages = OpenPassages(self.shares, self.expected)
        self.on_road = traversals_on_road(on_road, self.shares, self.expected)
        # A vehicle on the road that has left the fleet counts as one of its first profile.
        users = [(-n, user.vehicle) for n, user in enumerate(on_road, 1)]
        self._own_shares = {
            number: self.shares_by_profile[problem.profile_of(name)]
            for number, name in (*enumerate(v.id for v in problem.fleet.vehicles), *users)
            if name in problem.fleet.vehicle_by_id and problem.profile_of(name) != first
        }
        by_vehicle = {own.vehicle: own for own in commitments}
        self.bound: Mapping[int, Commitment] = {
            number: by_vehicle[vehicle.id]
            for number, vehicle in enumerate(problem.fleet.vehicles)
            if vehicle.id in by_vehicle
        }
        self._committed: dict[tuple[int, int], list[Leg] | None] = {}

    def meetings(self) -> Meetings:
        """Passages of the vehicles on the road only; their savings are part of no change."""
        meetings = Meetings(self.shares, self.sync_window_s, self._own_shares, self.expected)
        for vehicle in self.on_road:
            meetings.add(vehicle)
        return meetings

    def window_s(self, number: int) -> tuple[float, float]:
        """First and last moment at which a vehicle may leave; of a bound vehicle its place, where
        it may stay for others if it stands at a stop.
        """
        own = self.bound.get(number)
        if own is not None and own.may_wait and self.waits_on_tours:
            ends_s = 1e-9 * (own.ends_ns - self.snapshot.now_ns)
            # Its new plan has to be out.
            first_s = max(ends_s, self.reference_s)
            return first_s, max(first_s, ends_s + MAX_WAIT_S, self.planned_departure_s(number))
        if own is not None:
            begins_s = self.planned_departure_s(number)
            return begins_s, begins_s
        vehicle = self.problem.fleet.vehicles[number]
        latest = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
        return self.reference_s + vehicle.ready_s, self.reference_s + latest

    def planned_departure_s(self, number: int) -> float:
        """When the committed part of a bound vehicle's route begins by its present plan."""
        travel = self.travels[0].of(self.problem.fleet.vehicles[number])
        return departure_s(self.bound[number], travel.roads, self.snapshot.now_ns)

    def price_of_wait_kw(self, place: str) -> float:
        """Cost of waiting for other vehicles at a place on a tour, kWh an hour."""
        if place in self.problem.fleet.hub_by_id:
            return self.problem.price_of_waiting_kw
        return self.problem.price_of_standing_kw

    @property
    def waits_on_tours(self) -> bool:
        """Whether vehicles may wait for each other at stops and hubs; by the paper's objective at
        depots only.
        """
        return self.problem.objective == "energy"

    def followed_kwh(self, itinerary: Itinerary, from_s: float) -> float:
        """What a vehicle saves that follows another one on all open segments from a moment on."""
        return sum(
            self.shares[segment].following_kwh(entry)
            for segment, passages in itinerary.traversals.items()
            for entry, _, _ in passages
            if entry >= from_s
        )

    def legs(self, number: int, stops: Sequence[str], travel: int = 0) -> list[Leg] | None:
        """Legs of a route, over charging stops where the battery needs them, with the breaks of a
        vehicle that is free; None if one of them has no path or the battery does not last.
        """
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
        bound = number in self.bound
        found = self.batteries.with_stops(number, own, legs, len(fixed), under_way=bound)
        if found is None or bound or not vehicle.breaks:
            return found
        return with_breaks(self.problem, vehicle, found, self.reference_s)

    def lasts(self, number: int, legs: Sequence[Leg]) -> bool:
        """Whether a vehicle's battery lasts for a route, charged at its depot if need be."""
        return math.isfinite(self.ready_after_charging_s(number, legs))

    def ready_after_charging_s(self, number: int, legs: Sequence[Leg]) -> float:
        """When a vehicle can leave at the earliest, s; inf: its battery does not last."""
        return self.window_s(number)[0] + S_PER_H * self.batteries.needed_h(number, legs)

    def fixed_legs(self, number: int, travel: int = 0) -> list[Leg] | None:
        """The first legs of a bound vehicle, which are the same whatever it does; of any other
        vehicle there are none. None: no way leads on.
        """
        own = self.bound.get(number)
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
        legs: Sequence[Leg] | None,
        depart_s: float | None = None,
        waits_s: Sequence[float] = (),
    ) -> Itinerary | None:
        """A vehicle's itinerary over given legs; None if a window is missed, a path missing, or the
        charge falls below the reserve.

        Args:
            depart_s: None: as soon as it is ready, and charged as far as it needs. A bound vehicle
                goes on as it can.
            waits_s: for other vehicles, at the end of each leg but the last; none: nowhere.
        """
        bound = number in self.bound
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
        route = timed(self.problem, legs, vehicle, self.reference_s, depart_s, waits_s)
        # A departure computed from a meeting may miss its window by rounding.
        if lateness_s(self.problem, vehicle, route, self.reference_s) > _ROUNDING_S:
            return None
        at_depot_s = route.visits[0].departure_s - self.window_s(number)[0]
        return self._itinerary(number, stops, route, max(0.0, at_depot_s))

    def _bound_itinerary(
        self,
        number: int,
        stops: tuple[str, ...],
        legs: Sequence[Leg],
        depart_s: float | None,
        waits_s: Sequence[float],
    ) -> Itinerary | None:
        """What a bound vehicle has loaded is delivered, late or not, but later for no wait."""
        problem, vehicle = self.problem, self.problem.fleet.vehicles[number]
        first_s, last_s = self.window_s(number)
        begins_s = first_s if depart_s is None else min(max(depart_s, first_s), last_s)

        def driven(begins_s: float, waits_s: Sequence[float]) -> Route:
            route = timed(problem, legs, vehicle, self.reference_s, begins_s, waits_s)
            return self._standing_first(number, route)

        def late_s(route: Route) -> list[float]:
            return lateness_by_window_s(problem, vehicle, route, self.reference_s, under_way=True)

        # It waits as planned before a leg that is fixed.
        fixed = max(0, len(self.fixed_legs(number) or ()) - 1)
        planned_s = self.planned_waits_s(number, driven(first_s, ()))[:fixed] if fixed else ()
        at_once = driven(first_s, planned_s)
        waits_s = (*planned_s, *waits_s[fixed:])
        if begins_s == first_s and not any(waits_s[fixed:]):
            return self._itinerary(number, stops, at_once, 0.0)
        route = driven(begins_s, waits_s)
        for late, allowed in zip(late_s(route), late_s(at_once), strict=True):
            if late > max(0.0, allowed) + _ROUNDING_S:
                return None
        return self._itinerary(number, stops, route, 0.0)

    def _standing_first(self, number: int, route: Route) -> Route:
        """A bound vehicle's route from the stop that it stands at, with its wait there: without it
        the vehicle would leave as soon as it has the plan.
        """
        own, here = self.bound[number], route.visits[0]
        if own.moving is not None or not own.under_way:
            return route
        if own.departs_ns <= own.ends_ns and not own.may_wait:
            return route
        ready_s = max(0.0, 1e-9 * (own.ends_ns - self.snapshot.now_ns))
        wait_s = max(0.0, here.departure_s - ready_s)
        here = replace(here, arrival_s=here.departure_s - wait_s, wait_s=wait_s)
        return replace(route, visits=(here, *route.visits[1:]))

    def planned_waits_s(self, number: int, route: Route) -> tuple[float, ...]:
        """Waits of a vehicle's present plan on a route without any; none of a free vehicle."""
        own = self.bound.get(number)
        if own is None:
            return ()
        return planned_waits_s(self.problem, own, route, self.snapshot.now_ns, self.reference_s)

    def _itinerary(
        self, number: int, stops: tuple[str, ...], route: Route, at_depot_s: float
    ) -> Itinerary:
        problem = self.problem
        cost = sum(leg.cost_kwh for leg in route.legs)
        cost += problem.price_of_waiting_kw * at_depot_s / S_PER_H
        for visit in route.visits:
            if visit.wait_s:
                cost += self.price_of_wait_kw(visit.place) * visit.wait_s / S_PER_H
        return Itinerary(number, stops, route, cost, self.traversals(number, route))

    def traversals(self, number: int, route: Route) -> Traversals:
        """A route's passages of open segments.

        Args:
            number: of its vehicle.
        """
        return self._passages.of(number, route)
