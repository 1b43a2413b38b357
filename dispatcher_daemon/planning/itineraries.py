"""A vehicle's route with its times: one option of the route form, x_{k,r}."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

from dispatcher_daemon.commitments import Commitment
from dispatcher_daemon.planning.continuing import committed_legs, departure_s
from dispatcher_daemon.platooning import (
    Meetings,
    RoadUser,
    Shares,
    Traversals,
    open_shares,
    traversals,
    traversals_on_road,
)
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Leg, Route, Travel, lateness_s, timed
from dispatcher_daemon.traffic import TrafficSnapshot

_S_PER_H: Final = 3600.0


@dataclass(frozen=True)
class Itinerary:
    """One vehicle's exact route, its cost without platooning, and its passages of open segments.

    Attributes:
        number: of the vehicle in the fleet.
        stops: served in order; none: the vehicle stays idle.
        route: with its timetable; None for an idle vehicle.
        cost_kwh: Σ segment costs without platooning, and the cost of waiting at the depot.
        traversals: passages of open segments.
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
        return self.number, self.stops, paths, round(self.depart_s, 1)

    @property
    def depart_s(self) -> float:
        """When it leaves its depot."""
        return 0.0 if self.route is None else self.route.visits[0].departure_s


class Planner:
    """Makes itineraries of one fleet under one traffic snapshot.

    Attributes:
        travels: paths between places; the first are those of least energy, others alternatives.
        shares: saving of a leader and of a follower on each open segment.
        sync_window_s: Δt_sync.
        reference_s: when a vehicle that is ready at once leaves.
        paths_per_leg: number of cheapest paths of each leg that options may contain.
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
        self.shares: Mapping[str, Shares] = open_shares(problem, snapshot)
        self.reference_s = reference_s
        self.on_road = traversals_on_road(on_road, self.shares)
        by_vehicle = {own.vehicle: own for own in commitments}
        self.bound: Mapping[int, Commitment] = {
            number: by_vehicle[vehicle.id]
            for number, vehicle in enumerate(problem.fleet.vehicles)
            if vehicle.id in by_vehicle
        }
        self._committed: dict[tuple[int, int], list[Leg] | None] = {}

    def meetings(self) -> Meetings:
        """Passages of the vehicles on the road only; their savings are part of no change."""
        meetings = Meetings(self.shares, self.sync_window_s)
        for vehicle in self.on_road:
            meetings.add(vehicle)
        return meetings

    def window_s(self, number: int) -> tuple[float, float]:
        """First and last moment at which a vehicle may leave; one of a bound vehicle."""
        own = self.bound.get(number)
        if own is not None:
            begins_s = departure_s(own, self.travels[0].roads, self.snapshot.now_ns)
            return begins_s, begins_s
        vehicle = self.problem.fleet.vehicles[number]
        latest = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
        return self.reference_s + vehicle.ready_s, self.reference_s + latest

    def legs(self, number: int, stops: Sequence[str], travel: int = 0) -> list[Leg] | None:
        """Legs of a route; None if one of them has no path."""
        fleet = self.problem.fleet
        depot = fleet.depot_of(fleet.vehicles[number]).id
        fixed = self.fixed_legs(number, travel)
        if fixed is None:
            return None
        legs = list(fixed)
        for start, end in list(pairwise((depot, *stops, depot)))[len(fixed) :]:
            leg = self.travels[travel].leg(start, end)
            if leg is None:
                return None
            legs.append(leg)
        return legs

    def fixed_legs(self, number: int, travel: int = 0) -> list[Leg] | None:
        """The first legs of a bound vehicle, which are the same whatever it does; of any other
        vehicle there are none. None: no way leads on.
        """
        own = self.bound.get(number)
        if own is None:
            return []
        if (number, travel) not in self._committed:
            vehicle = self.problem.fleet.vehicles[number]
            legs = committed_legs(self.problem, self.travels[travel], own, vehicle)
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
    ) -> Itinerary | None:
        """A vehicle's itinerary over given legs; None if a window is missed or a path missing.

        Args:
            depart_s: None: as soon as it is ready. A bound vehicle goes on as it can.
        """
        bound = number in self.bound
        if not stops and not bound:
            return self.idle(number)
        if legs is None:
            return None
        vehicle = self.problem.fleet.vehicles[number]
        if bound:
            # What it has loaded is delivered, late or not.
            route = timed(self.problem, legs, vehicle, self.reference_s, self.window_s(number)[0])
            cost = sum(leg.cost_kwh for leg in legs)
            return Itinerary(number, stops, route, cost, traversals(number, route, self.shares))
        route = timed(self.problem, legs, vehicle, self.reference_s, depart_s)
        # A departure computed from a meeting may miss its window by rounding.
        if lateness_s(self.problem, vehicle, route, self.reference_s) > 1e-6:
            return None
        waits_s = route.visits[0].departure_s - self.window_s(number)[0]
        cost = sum(leg.cost_kwh for leg in legs)
        cost += self.problem.value_of_waiting_kw * max(0.0, waits_s) / _S_PER_H
        return Itinerary(number, stops, route, cost, traversals(number, route, self.shares))
