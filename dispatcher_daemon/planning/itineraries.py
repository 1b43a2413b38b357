"""A vehicle's route with its times: one option of the route form, x_{k,r}."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

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
        shares: saving of a leader and of a follower of the fleet's first profile on each open
            segment.
        shares_by_profile: those of all its profiles.
        sync_window_s: Δt_sync.
        reference_s: when a vehicle that is ready at once leaves.
        paths_per_leg: number of cheapest paths of each leg that options may contain.
        on_road: passages of open segments by vehicles that earlier cycles sent; they stay as they
            are.
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
        self.on_road = traversals_on_road(on_road, self.shares)
        # A vehicle on the road that has left the fleet counts as one of its first profile.
        users = [(-n, user.vehicle) for n, user in enumerate(on_road, 1)]
        self._own_shares = {
            number: self.shares_by_profile[problem.profile_of(name)]
            for number, name in (*enumerate(v.id for v in problem.fleet.vehicles), *users)
            if name in problem.fleet.vehicle_by_id and problem.profile_of(name) != first
        }

    def meetings(self) -> Meetings:
        """Passages of the vehicles on the road only; their savings are part of no change."""
        meetings = Meetings(self.shares, self.sync_window_s, self._own_shares)
        for vehicle in self.on_road:
            meetings.add(vehicle)
        return meetings

    def window_s(self, number: int) -> tuple[float, float]:
        """First and last moment at which a vehicle may leave."""
        vehicle = self.problem.fleet.vehicles[number]
        latest = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
        return self.reference_s + vehicle.ready_s, self.reference_s + latest

    def legs(self, number: int, stops: Sequence[str], travel: int = 0) -> list[Leg] | None:
        """Legs of a route; None if one of them has no path."""
        fleet = self.problem.fleet
        vehicle = fleet.vehicles[number]
        depot, own = fleet.depot_of(vehicle).id, self.travels[travel].of(vehicle)
        legs = []
        for start, end in pairwise((depot, *stops, depot)):
            leg = own.leg(start, end)
            if leg is None:
                return None
            legs.append(leg)
        return legs

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
            depart_s: None: as soon as it is ready.
        """
        if not stops:
            return self.idle(number)
        if legs is None:
            return None
        vehicle = self.problem.fleet.vehicles[number]
        route = timed(self.problem, legs, vehicle, self.reference_s, depart_s)
        # A departure computed from a meeting may miss its window by rounding.
        if lateness_s(self.problem, vehicle, route, self.reference_s) > 1e-6:
            return None
        waits_s = route.visits[0].departure_s - self.window_s(number)[0]
        cost = sum(leg.cost_kwh for leg in legs)
        cost += self.problem.value_of_waiting_kw * max(0.0, waits_s) / _S_PER_H
        return Itinerary(number, stops, route, cost, traversals(number, route, self.shares))
