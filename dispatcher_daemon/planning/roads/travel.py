"""Least-cost paths between all places of a fleet.

Energies and times of all pairs come from one search over the segments, in arrays. A city has a
million pairs and drives a thousand of them, so a leg with its path and drive is computed on demand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from dispatcher_daemon.fleet import Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads.all_pairs import AllPairs
from dispatcher_daemon.planning.roads.arrays import Roads, roads_of
from dispatcher_daemon.planning.roads.routes import RoadLeg, empty_leg
from dispatcher_daemon.planning.roads.weights import Floats, Weights, k_shortest_paths
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy.consumption import drive_energy_kwh
from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.vehicle_types import RoutingProfile


class Travel:
    """Least-cost paths between the places of a fleet, for vehicles of one profile.

    Attributes:
        places: depots, stops and charging stops.
        row: place → row and column of its junction in the matrices; there are n junctions.
        search_cost_kwh: of the path from junction i to junction j, with the discounts that the
            search was given, inf where there is none, shape (n, n).
        duration_s: of its drive, to about a second, shape (n, n).
        searched: the costs that the search minimised.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        roads: Roads,
        discount_kwh: Floats | None = None,
        others: Sequence[Travel] = (),
        may_go_on: Callable[[float], bool] = lambda _: True,
    ) -> None:
        """Search.

        Args:
            discount_kwh: taken off each segment's cost in the search, shape (m,); energies stay
                those of the path that is found. At least 1 % of a cost is left.
            others: the same for vehicles of other profiles; see `of`.

        Raises:
            TimeoutError: the search may not go on.
        """
        self._problem, self.roads = problem, roads
        self.by_profile: Mapping[RoutingProfile, Travel] = {
            **{other.roads.profile: other for other in others},
            roads.profile: self,
        }
        fleet = problem.fleet
        self.places = (
            *(d.id for d in fleet.depots),
            *(s.id for s in fleet.stops),
            *(c.id for c in fleet.charging_stops),
            *(h.id for h in fleet.hubs),
        )
        self._nodes = sorted({fleet.node(place) for place in self.places})
        at = {node: i for i, node in enumerate(self._nodes)}
        self.row = {place: at[fleet.node(place)] for place in self.places}
        searched = roads.objective
        if discount_kwh is not None:
            searched = searched.discounted(discount_kwh, roads.turn)
        self.searched = searched
        self._pairs = AllPairs(roads, searched, self._nodes)
        kinds = searched, roads.costs.time
        self.search_cost_kwh, self.duration_s = self._pairs.search(kinds, may_go_on)
        for values in (self.search_cost_kwh, self.duration_s):
            np.fill_diagonal(values, 0.0)
        self._legs: dict[tuple[str, str], RoadLeg | None] = {}
        # By junction: stops at one junction share their ways.
        self._of_rows: dict[tuple[int, int], RoadLeg | None] = {}
        self._paths: dict[tuple[int, int, int], list[list[int]]] = {}

    @cached_property
    def energy_kwh(self) -> Floats:
        """Energy of the same paths, without discounts, inf where there is none, shape (n, n)."""
        (found,) = self._pairs.along((self.roads.costs.energy,))
        np.fill_diagonal(found, 0.0)
        return found

    @cached_property
    def distance_m(self) -> Floats:
        """Length of the same paths, inf where there is none, shape (n, n)."""
        length_m, turn = self.roads.length_m, self.roads.turn
        whole = Weights(length_m[turn[0]], np.zeros_like(length_m), length_m, on_exit=True)
        (found,) = self._pairs.along((whole,))
        np.fill_diagonal(found, 0.0)
        return found

    @cached_property
    def turn_graph(self) -> csr_array:
        """Turns with their searched costs, over segments, shape (m, m)."""
        m = len(self.roads.ids)
        turn = self.roads.turn
        return csr_array((self.searched.turn, (turn[0], turn[1])), shape=(m, m))

    def of(self, vehicle: Vehicle) -> Travel:
        """The paths of a vehicle's profile."""
        return self.by_profile[self._problem.profile_of(vehicle)]

    def leg(self, start: str, end: str) -> RoadLeg | None:
        """The path between two places; None if there is none."""
        if (start, end) not in self._legs:
            pair = self.row[start], self.row[end]
            if pair not in self._of_rows:
                self._of_rows[pair] = self._make(*pair, start, end)
            known = self._of_rows[pair]
            self._legs[start, end] = None if known is None else replace(known, start=start, end=end)
        return self._legs[start, end]

    def paths(self, start: str, end: str, max_paths: int) -> list[RoadLeg]:
        """The k cheapest loopless paths between two places, k = ``max_paths`` (Yen, 1971).

        Each takes tens of milliseconds on a city's network.
        """
        i, j = self.row[start], self.row[end]
        key = i, j, max_paths
        if key not in self._paths:
            roads, nodes = self.roads, self._nodes
            ends = roads.leaving[nodes[i]], roads.entering[nodes[j]]
            reached = self._pairs.last[i, j] >= 0
            self._paths[key] = (
                k_shortest_paths(roads.turn, roads.objective, *ends, max_paths) if reached else []
            )
        style = self._problem.style
        return [leg_along(self.roads, path, start, end, style) for path in self._paths[key]]

    def _make(self, i: int, j: int, start: str, end: str) -> RoadLeg | None:
        if i == j:
            return empty_leg(start, end)
        if self._pairs.last[i, j] < 0:
            return None
        return leg_along(self.roads, self._pairs.path(i, j), start, end, self._problem.style)


def fleet_travel(problem: RoutingProblem, snapshot: TrafficSnapshot) -> Travel:
    """Least-cost paths of all profiles of a fleet: the first one's, which knows the others'."""
    first, *others = (roads_of(problem, snapshot, profile) for profile in problem.profiles)
    return Travel(problem, first, others=[Travel(problem, roads) for roads in others])


def searched_again(
    travel: Travel,
    problem: RoutingProblem,
    discount_kwh: Callable[[Roads], Floats | None] = lambda _: None,
    may_go_on: Callable[[float], bool] = lambda _: True,
) -> Travel:
    """The same roads searched for another fleet, or with discounts, for each of its profiles.

    Args:
        may_go_on: asked now and then with the share of all searches that is done.

    Raises:
        TimeoutError: they may not go on.
    """
    first, *others = (travel.by_profile[profile].roads for profile in problem.profiles)

    def in_all(before: int) -> Callable[[float], bool]:
        return lambda done: may_go_on((before + done) / len(problem.profiles))

    found = [
        Travel(problem, roads, discount_kwh(roads), may_go_on=in_all(number))
        for number, roads in enumerate(others)
    ]
    return Travel(problem, first, discount_kwh(first), found, in_all(len(found)))


def least_energy_legs(
    problem: RoutingProblem, snapshot: TrafficSnapshot
) -> dict[tuple[str, str], RoadLeg]:
    """Least-energy path of every candidate arc, by (from, to), except pairs without a path.

    Raises:
        ValueError: the fleet's vehicles are of several profiles, whose paths differ.
    """
    if len(problem.profiles) > 1:
        raise ValueError("vehicles of different types have no paths in common")
    travel, fleet = Travel(problem, roads_of(problem, snapshot)), problem.fleet
    wanted = sorted({pair for vehicle in fleet.vehicles for pair in fleet.legs(vehicle)})
    legs = {pair: travel.leg(*pair) for pair in wanted}
    return {pair: leg for pair, leg in legs.items() if leg is not None}


def leg_along(
    roads: Roads, path: Sequence[int], start: str, end: str, style: DrivingStyle
) -> RoadLeg:
    """The leg along given segments (indices into ``roads.ids``)."""
    rows = np.array(path)
    drive = plan_drive(roads.length_m[rows].tolist(), roads.speed_mps[rows].tolist(), style)
    costs = roads.costs
    if costs.waiting_s is not None:
        turns_taken = [roads.turn_number[pair] for pair in pairwise(path)]
        drive = drive.delayed([*costs.waiting_s[turns_taken].tolist(), 0.0])
    names = tuple(roads.ids[i] for i in path)
    drive_kwh = drive_energy_kwh(drive, roads.profile.physics)
    beyond_kwh = roads.cost(costs.expected, path) - (drive_kwh if costs.observed else 0.0)
    if costs.exact:
        cost_kwh = roads.searched_kwh(drive_kwh + beyond_kwh, drive.duration_s)
    else:
        cost_kwh = roads.cost(roads.objective, path)
    return RoadLeg(start, end, names, cost_kwh, drive, beyond_kwh)
