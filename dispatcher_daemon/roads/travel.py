"""Least-cost paths between all places of a fleet.

Energies and times of all pairs come from one search over the segments, in arrays. A city has a
million pairs and drives a thousand of them, so a leg with its path and drive is computed on demand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.fleet import Vehicle
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.costs import (
    held_cost_kwh,
    planning_speed_mps,
    segment_cost_kwh,
)
from dispatcher_daemon.roads.routes import Leg, empty_leg
from dispatcher_daemon.roads.turns import Basis, TurnCosts, search_weights
from dispatcher_daemon.roads.weights import Floats, Ints, Weights, k_shortest_paths
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.drive import DrivingStyle, plan_drive
from slipstream.energy import drive_energy_kwh, steady_energy_kwh
from slipstream.vehicle_types import RoutingProfile

_S_PER_H = 3600.0
_SEARCHED_AT_ONCE = 4_000_000
"""Distances that a search holds at a time, 32 MB of them."""

Ints32 = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Roads:
    """A network under given traffic as arrays over its segments, in the order of their ids, for
    vehicles of one profile.

    Attributes:
        profile: theirs.
        ids: segment ids.
        cost_kwh: expected energy of a vehicle alone, > 0, shape (m,).
        speed_mps: planning speeds, shape (m,).
        length_m: shape (m,).
        turn: pairs of segments (from, onto) that the vehicles may take, shape (2, t).
        costs: of paths; durations to about a second.
        objective: cost that the search minimises, kWh.
        search: the problem's.
        price_of_time_kw: the problem's.
        index: position by id.
        leaving: positions of the segments that leave a junction and that the vehicles may use, by
            junction; so `entering`.
    """

    profile: RoutingProfile
    ids: tuple[str, ...]
    cost_kwh: Floats
    speed_mps: Floats
    length_m: Floats
    turn: Ints
    costs: TurnCosts
    objective: Weights
    search: Literal["energy", "time"]
    price_of_time_kw: float
    index: Mapping[str, int] = field(repr=False)
    leaving: Mapping[str, list[int]] = field(repr=False)
    entering: Mapping[str, list[int]] = field(repr=False)

    @cached_property
    def turn_number(self) -> dict[tuple[int, int], int]:
        """Numbers of the turns, by (from, onto)."""
        return {(a, b): i for i, (a, b) in enumerate(self.turn.T.tolist())}

    @cached_property
    def predecessors(self) -> list[tuple[Ints, Ints]]:
        """For the first turn onto each segment, the second one ...: origin segments and turn
        numbers, shape (m,) each; -1 and 0 where a segment has no more.
        """
        m, count = len(self.ids), self.turn.shape[1]
        order = np.argsort(self.turn[1], kind="stable")
        onto = self.turn[1, order]
        rank = np.arange(count) - np.searchsorted(onto, onto, "left")
        found = []
        for k in range(int(rank.max(initial=-1)) + 1):
            chosen = order[rank == k]
            origin, number = np.full(m, -1), np.zeros(m, dtype=np.int64)
            origin[self.turn[1, chosen]] = self.turn[0, chosen]
            number[self.turn[1, chosen]] = chosen
            found.append((origin, number))
        return found

    def cost(self, weights: Weights, path: Sequence[int]) -> float:
        """Cost of a path over these segments."""
        return weights.along(path, [self.turn_number[pair] for pair in pairwise(path)])

    def searched_kwh(self, energy_kwh: float, duration_s: float) -> float:
        """What the search minimises, of a drive."""
        price_kw, of_energy = (1.0, 0.0) if self.search == "time" else (self.price_of_time_kw, 1.0)
        return of_energy * energy_kwh + price_kw * duration_s / _S_PER_H


def roads_of(
    problem: RoutingProblem, snapshot: TrafficSnapshot, profile: RoutingProfile | None = None
) -> Roads:
    """The arrays of a problem's network.

    Observed losses of movements are those of the problem's `vehicle`; other vehicles' are taken to
    differ as their costs of the segments do.

    Args:
        profile: of the vehicles; None: the fleet's first.
    """
    network = problem.network
    profile = problem.profiles[0] if profile is None else profile
    ids = tuple(sorted(network.segments))
    index = {name: i for i, name in enumerate(ids)}
    leaving: dict[str, list[int]] = {node: [] for node in network.junctions}
    entering: dict[str, list[int]] = {node: [] for node in network.junctions}
    usable = {name for name in ids if network.admits(name, profile)}
    for i, name in enumerate(ids):
        if name in usable:
            leaving[network.segments[name].start].append(i)
            entering[network.segments[name].end].append(i)
    pairs = [
        (index[a], index[b])
        for a in ids
        for b in dict.fromkeys(network.turns(a))
        if a in usable and b in usable and network.admits_turn(a, b, profile)
    ]
    turn = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    segments = [(network.segments[s], snapshot.segments[s]) for s in ids]
    cost = np.array([segment_cost_kwh(*pair, profile) for pair in segments])
    speed = np.array([planning_speed_mps(*pair, profile) for pair in segments])
    factor: Floats | float = 1.0
    observed = RoutingProfile(problem.vehicle)
    if snapshot.expected is not None and profile.physics != observed.physics:
        factor = cost / np.array([segment_cost_kwh(*pair, observed) for pair in segments])
        # Slow traffic hardly has drag: no vehicle loses less than it needs for rolling.
        own, other = profile.physics, observed.physics
        rolling = own.electrical_kwh(own.rolling_force_n)
        factor = np.maximum(factor, rolling / other.electrical_kwh(other.rolling_force_n))
    length = np.array([network.segments[s].length_m for s in ids])
    held = np.array([held_cost_kwh(*pair, profile) for pair in segments])
    calm = [
        steady_energy_kwh(*pair, vehicle=profile.physics)
        for pair in zip(length, speed, strict=True)
    ]
    stops = np.array([traffic.stops for _, traffic in segments])
    basis = Basis(
        *(ids, turn, cost, held, np.array(calm), stops, speed, length),
        problem.style,
        profile.physics,
    )
    exact = problem.objective == "energy"
    if snapshot.expected is not None:
        costs = basis.observed_costs(snapshot.expected, factor, exact=exact)
    else:
        costs = basis.drive_costs() if exact else basis.paper_costs()
    return Roads(
        profile,
        ids,
        cost,
        speed,
        length,
        turn,
        costs,
        search_weights(costs, problem.search, problem.price_of_time_kw),
        problem.search,
        problem.price_of_time_kw,
        index,
        leaving,
        entering,
    )


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
    ) -> None:
        """Search.

        Args:
            discount_kwh: taken off each segment's cost in the search, shape (m,); energies stay
                those of the path that is found. At least 1 % of a cost is left.
            others: the same for vehicles of other profiles; see `of`.
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
        m, n = len(roads.ids), len(self._nodes)
        self._before = np.empty((n, m), dtype=np.int32)
        self._last = np.empty((n, n), dtype=np.int32)
        self.search_cost_kwh, self.duration_s = np.empty((n, n)), np.empty((n, n))
        for rows, before, last in self._searched_paths():
            self._before[rows], self._last[rows] = before, last
            found = self._along_paths(before, last, (searched, roads.costs.time))
            self.search_cost_kwh[rows], self.duration_s[rows] = found
        for values in (self.search_cost_kwh, self.duration_s):
            np.fill_diagonal(values, 0.0)
        self._legs: dict[tuple[int, int], Leg | None] = {}
        self._paths: dict[tuple[int, int, int], list[list[int]]] = {}

    @cached_property
    def energy_kwh(self) -> Floats:
        """Energy of the same paths, without discounts, inf where there is none, shape (n, n)."""
        (found,) = self._along_paths(self._before, self._last, (self.roads.costs.energy,))
        np.fill_diagonal(found, 0.0)
        return found

    @cached_property
    def turn_graph(self) -> csr_array:
        """Turns with their searched costs, over segments, shape (m, m)."""
        m = len(self.roads.ids)
        turn = self.roads.turn
        return csr_array((self.searched.turn, (turn[0], turn[1])), shape=(m, m))

    def of(self, vehicle: Vehicle) -> Travel:
        """The paths of a vehicle's profile.

        Raises:
            KeyError: it is not among those that were searched.
        """
        return self.by_profile[self._problem.profile_of(vehicle)]

    def _searched_paths(self) -> Iterator[tuple[slice, Ints32, Ints32]]:
        """(rows, predecessors, shape (rows, m), last segments, shape (rows, n)) of the paths from
        some junctions at a time: a search's distances are many times larger than what is kept.
        """
        roads, cost = self.roads, self.searched
        m, n = len(roads.ids), len(self._nodes)
        out = [roads.leaving[node] for node in self._nodes]
        onto = np.concatenate([roads.turn[1], *(np.array(o, dtype=np.int64) for o in out)])
        start = np.repeat(np.arange(m, m + n), [len(o) for o in out])
        graph = csr_array(
            (
                np.concatenate([cost.turn, *(cost.entry[o] for o in out)]),
                (np.concatenate([roads.turn[0], start]), onto),
            ),
            shape=(m + n, m + n),
        )
        into = [np.array(roads.entering[node]) for node in self._nodes]
        step = max(1, _SEARCHED_AT_ONCE // (m + n))
        for first in range(0, n, step):
            rows = slice(first, min(first + step, n))
            distance, before = dijkstra(
                graph, indices=np.arange(m + rows.start, m + rows.stop), return_predecessors=True
            )
            origins = np.arange(rows.start, rows.stop)
            last = np.full((len(origins), n), -1, dtype=np.int32)
            for j, ends in enumerate(into):
                if len(ends):
                    whole = distance[:, ends] + cost.finish[ends]
                    best = ends[whole.argmin(axis=1)]
                    reached = np.isfinite(distance[np.arange(len(origins)), best])
                    last[reached, j] = best[reached]
            last[np.arange(len(origins)), origins] = -1
            yield rows, before[:, :m], last

    def _along_paths(
        self, before: Ints32, last: Ints32, kinds: Sequence[Weights]
    ) -> Iterator[Floats]:
        """Costs of each kind to all junctions, summed along the paths found, shape (rows, n); inf
        where there is none.
        """
        roads = self.roads
        count, m = before.shape
        # One more segment, m, stands for the start: it costs nothing and precedes itself.
        before = np.where((before < 0) | (before >= m), m, before)
        before = np.hstack([before, np.full((count, 1), m, dtype=before.dtype)])
        turn = np.zeros((count, m), dtype=np.int32)
        for origin, number in roads.predecessors:
            turn = np.where(before[:, :m] == origin, number, turn)
        sums = [
            np.hstack(
                [
                    np.where(before[:, :m] == m, w.begin, _values_at(w.turn, turn)),
                    np.zeros((count, 1)),
                ]
            )
            for w in kinds
        ]
        # Each round doubles how much of a path its last segment stands for.
        while (before != m).any():
            for values in sums:
                values += np.take_along_axis(values, before, axis=1)
            before = np.take_along_axis(before, before, axis=1)
        paths = last >= 0
        ends = np.where(paths, last, m)
        for values, w in zip(sums, kinds, strict=True):
            total = np.take_along_axis(values, ends, axis=1) + np.append(w.finish, 0.0)[ends]
            total[~paths] = np.inf
            yield total

    def leg(self, start: str, end: str) -> Leg | None:
        """The path between two places; None if there is none."""
        pair = self.row[start], self.row[end]
        if pair not in self._legs:
            self._legs[pair] = self._make(*pair, start, end)
        known = self._legs[pair]
        if known is None or (known.start, known.end) == (start, end):
            return known
        return replace(known, start=start, end=end)

    def paths(self, start: str, end: str, max_paths: int) -> list[Leg]:
        """The k cheapest loopless paths between two places, k = ``max_paths`` (Yen, 1971).

        Each takes tens of milliseconds on a city's network.
        """
        i, j = self.row[start], self.row[end]
        key = i, j, max_paths
        if key not in self._paths:
            roads, nodes = self.roads, self._nodes
            ends = roads.leaving[nodes[i]], roads.entering[nodes[j]]
            reached = self._last[i, j] >= 0
            self._paths[key] = (
                k_shortest_paths(roads.turn, roads.objective, *ends, max_paths) if reached else []
            )
        style = self._problem.style
        return [leg_along(self.roads, path, start, end, style) for path in self._paths[key]]

    def _make(self, i: int, j: int, start: str, end: str) -> Leg | None:
        if i == j:
            return empty_leg(start, end)
        if self._last[i, j] < 0:
            return None
        path = [int(self._last[i, j])]
        while self._before[i, path[-1]] < len(self.roads.ids):
            path.append(int(self._before[i, path[-1]]))
        return leg_along(self.roads, path[::-1], start, end, self._problem.style)


def fleet_travel(problem: RoutingProblem, snapshot: TrafficSnapshot) -> Travel:
    """Least-cost paths of all profiles of a fleet: the first one's, which knows the others'."""
    first, *others = (roads_of(problem, snapshot, profile) for profile in problem.profiles)
    return Travel(problem, first, others=[Travel(problem, roads) for roads in others])


def searched_again(
    travel: Travel,
    problem: RoutingProblem,
    discount_kwh: Callable[[Roads], Floats | None] = lambda _: None,
) -> Travel:
    """The same roads searched for another fleet, or with discounts, for each of its profiles."""
    first, *others = (travel.by_profile[profile].roads for profile in problem.profiles)
    return Travel(
        problem,
        first,
        discount_kwh(first),
        [Travel(problem, roads, discount_kwh(roads)) for roads in others],
    )


def least_energy_legs(
    problem: RoutingProblem, snapshot: TrafficSnapshot
) -> dict[tuple[str, str], Leg]:
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


def leg_along(roads: Roads, path: Sequence[int], start: str, end: str, style: DrivingStyle) -> Leg:
    """The leg along given segments (indices into ``roads.ids``)."""
    rows = np.array(path)
    drive = plan_drive(roads.length_m[rows].tolist(), roads.speed_mps[rows].tolist(), style)
    costs = roads.costs
    if costs.waiting_s is not None:
        turns_taken = [roads.turn_number[pair] for pair in pairwise(path)]
        drive = drive.delayed([*costs.waiting_s[turns_taken].tolist(), 0.0])
    names = tuple(roads.ids[i] for i in path)
    if costs.beyond is not None:
        beyond_kwh = roads.cost(costs.beyond, path)
        energy_kwh = drive_energy_kwh(drive, roads.profile.physics) + beyond_kwh
        cost_kwh = roads.searched_kwh(energy_kwh, drive.duration_s)
        return Leg(start, end, names, cost_kwh, drive, beyond_kwh)
    beyond_kwh = 0.0
    if costs.waiting_s is not None:
        beyond_kwh = roads.cost(costs.energy, path)
        beyond_kwh -= drive_energy_kwh(drive, roads.profile.physics)
    return Leg(start, end, names, roads.cost(roads.objective, path), drive, beyond_kwh)


def _values_at(values: Floats, at: Ints32) -> Floats:
    """Values at indices; zeros where there are no values, as in a network without turns."""
    return values[at] if len(values) else np.zeros(at.shape)
