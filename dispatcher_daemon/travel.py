"""Ways between all places of a fleet: energy and time of each, and the leg itself when asked for.

A city has a million pairs of places and drives a thousand of them. So energies and times of all
pairs come from one search over the segments, in arrays; a leg with its path and its drive is made
when somebody wants it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra, yen

from dispatcher_daemon.costs import segment_cost_kwh
from dispatcher_daemon.drive import DrivingStyle, plan_drive
from dispatcher_daemon.paths import turns
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.routes import Leg, still_leg
from dispatcher_daemon.traffic import TrafficSnapshot

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
_FEWEST_S = 1e-9


@dataclass(frozen=True)
class Roads:
    """A network under given traffic as arrays over its segments, in the order of their ids.

    Attributes:
        ids: segment ids.
        cost_kwh: expected energy of a vehicle alone, > 0, shape (m,).
        speed_mps: planning speeds, shape (m,).
        length_m: shape (m,).
        turn: pairs of segments (from, onto), shape (2, t).
        index: position by id.
        leaving: positions of the segments that leave a junction, by junction; so `entering`.
    """

    ids: tuple[str, ...]
    cost_kwh: Floats
    speed_mps: Floats
    length_m: Floats
    turn: Ints
    index: Mapping[str, int] = field(repr=False)
    leaving: Mapping[str, list[int]] = field(repr=False)
    entering: Mapping[str, list[int]] = field(repr=False)


def roads_of(problem: RoutingProblem, snapshot: TrafficSnapshot) -> Roads:
    """The arrays of a problem's network."""
    network = problem.network
    ids = tuple(sorted(network.segments))
    index = {name: i for i, name in enumerate(ids)}
    leaving: dict[str, list[int]] = {node: [] for node in network.junctions}
    entering: dict[str, list[int]] = {node: [] for node in network.junctions}
    for i, name in enumerate(ids):
        leaving[network.segments[name].start].append(i)
        entering[network.segments[name].end].append(i)
    pairs = [(index[a], index[b]) for a in ids for b in dict.fromkeys(turns(network, a))]
    return Roads(
        ids,
        np.array(
            [
                segment_cost_kwh(network.segments[s], snapshot.segments[s], problem.vehicle)
                for s in ids
            ]
        ),
        np.array([snapshot.segments[s].speed_mps for s in ids]),
        np.array([network.segments[s].length_m for s in ids]),
        np.array(pairs, dtype=np.int64).reshape(-1, 2).T,
        index,
        leaving,
        entering,
    )


class Travel:
    """Least-cost ways between the places of a fleet.

    Attributes:
        places: depots and stops.
        row: place → row and column in the matrices.
        energy_kwh: of the way from place i to place j, inf where there is none, shape (n, n).
        searched_kwh: the same with the discounts that the search was given, shape (n, n).
        duration_s: of its drive, to about a second, shape (n, n).
    """

    def __init__(
        self, problem: RoutingProblem, roads: Roads, discount_kwh: Floats | None = None
    ) -> None:
        """Search.

        Args:
            discount_kwh: taken off each segment's cost in the search, shape (m,); energies stay
                those of the way that is found. At least 1 % of a cost is left.
        """
        self._problem, self.roads = problem, roads
        fleet = problem.fleet
        self.places = (*(d.id for d in fleet.depots), *(s.id for s in fleet.stops))
        self.row = {place: i for i, place in enumerate(self.places)}
        self._nodes = sorted({fleet.node(place) for place in self.places})
        at = {node: i for i, node in enumerate(self._nodes)}
        self._node_of = np.array([at[fleet.node(place)] for place in self.places])
        searched = roads.cost_kwh
        if discount_kwh is not None:
            searched = np.maximum(searched - discount_kwh, 0.01 * searched)
        self._before, self._last = self._search(searched)
        pairs = np.ix_(self._node_of, self._node_of)
        self.searched_kwh, self.energy_kwh, self.duration_s = (
            values[pairs] for values in self._along_ways(searched)
        )
        self._legs: dict[tuple[int, int], Leg | None] = {}
        self._ways: dict[tuple[int, int, int], list[list[int]]] = {}

    def _search(self, cost: Floats) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """(predecessors, shape (nodes, m); last segment of each way, shape (nodes, nodes))."""
        roads = self.roads
        m, n = len(roads.ids), len(self._nodes)
        out = [roads.leaving[node] for node in self._nodes]
        onto = np.concatenate([roads.turn[1], *(np.array(o, dtype=np.int64) for o in out)])
        start = np.repeat(np.arange(m, m + n), [len(o) for o in out])
        graph = csr_array(
            (cost[onto], (np.concatenate([roads.turn[0], start]), onto)), shape=(m + n, m + n)
        )
        distance, before = dijkstra(graph, indices=np.arange(m, m + n), return_predecessors=True)
        last = np.full((n, n), -1, dtype=np.int32)
        for j, node in enumerate(self._nodes):
            into = roads.entering[node]
            if into:
                best = np.array(into)[distance[:, into].argmin(axis=1)]
                reached = np.isfinite(distance[np.arange(n), best])
                last[reached, j] = best[reached]
        np.fill_diagonal(last, -1)
        return before[:, :m], last

    def _along_ways(self, searched: Floats) -> tuple[Floats, Floats, Floats]:
        """Searched cost, energy and duration between nodes, summed along the ways found, shape
        (n, n) each.
        """
        roads, style = self.roads, self._problem.style
        m, n = len(roads.ids), len(self._nodes)
        # One more segment, m, stands for the start: it costs nothing and comes before itself.
        before = np.where((self._before < 0) | (self._before >= m), m, self._before)
        before = np.hstack([before, np.full((n, 1), m)]).astype(np.int64)
        speed = np.append(roads.speed_mps, 0.0)
        cost, energy = (np.tile(np.append(c, 0.0), (n, 1)) for c in (searched, roads.cost_kwh))
        seconds = np.append(roads.length_m / roads.speed_mps, 0.0) + _change_s(
            speed[before], speed, style
        )
        seconds[:, m] = 0.0
        # Each round doubles how much of a way its last segment stands for.
        while (before != m).any():
            for values in (cost, energy, seconds):
                values += np.take_along_axis(values, before, axis=1)
            before = np.take_along_axis(before, before, axis=1)
        rows = np.arange(n)[:, None]
        ways = self._last >= 0
        last = np.where(ways, self._last, m)
        cost, energy, seconds = cost[rows, last], energy[rows, last], seconds[rows, last]
        seconds += speed[last] / (2 * style.braking_mps2)
        for values in (cost, energy, seconds):
            values[~ways] = np.inf
            np.fill_diagonal(values, 0.0)
        return cost, energy, seconds

    def leg(self, start: str, end: str) -> Leg | None:
        """The way between two places; None if there is none."""
        pair = int(self._node_of[self.row[start]]), int(self._node_of[self.row[end]])
        if pair not in self._legs:
            self._legs[pair] = self._make(*pair, start, end)
        known = self._legs[pair]
        if known is None or (known.start, known.end) == (start, end):
            return known
        return Leg(start, end, known.path, known.cost_kwh, known.drive)

    def ways(self, start: str, end: str, most: int) -> list[Leg]:
        """The cheapest ways between two places without a loop, at most so many (Yen, 1971).

        Each takes tens of milliseconds on a city's network.
        """
        i, j = int(self._node_of[self.row[start]]), int(self._node_of[self.row[end]])
        key = i, j, most
        if key not in self._ways:
            self._ways[key] = self._cheapest(i, j, most) if self._last[i, j] >= 0 else []
        style = self._problem.style
        return [leg_along(self.roads, way, start, end, style) for way in self._ways[key]]

    def _cheapest(self, i: int, j: int, most: int) -> list[list[int]]:
        roads = self.roads
        m = len(roads.ids)
        out, into = roads.leaving[self._nodes[i]], roads.entering[self._nodes[j]]
        # Segments, then the start and the end, which costs next to nothing: 0 would be no edge.
        rows = np.concatenate([roads.turn[0], np.full(len(out), m), into])
        columns = np.concatenate([roads.turn[1], out, np.full(len(into), m + 1)])
        cost = np.concatenate(
            [roads.cost_kwh[columns[: len(rows) - len(into)]], [1e-12] * len(into)]
        )
        graph = csr_array((cost, (rows, columns)), shape=(m + 2, m + 2))
        # It takes 32-bit indices only.
        graph.indices, graph.indptr = graph.indices.astype(np.int32), graph.indptr.astype(np.int32)
        _, before = yen(graph, m, m + 1, most, return_predecessors=True)
        found = []
        for row in before:
            way = [int(row[m + 1])]
            while row[way[-1]] != m:
                way.append(int(row[way[-1]]))
            found.append(way[::-1])
        return found

    def _make(self, i: int, j: int, start: str, end: str) -> Leg | None:
        if i == j:
            return still_leg(start, end)
        if self._last[i, j] < 0:
            return None
        way = [int(self._last[i, j])]
        while self._before[i, way[-1]] < len(self.roads.ids):
            way.append(int(self._before[i, way[-1]]))
        return leg_along(self.roads, way[::-1], start, end, self._problem.style)


def least_energy_legs(
    problem: RoutingProblem, snapshot: TrafficSnapshot
) -> dict[tuple[str, str], Leg]:
    """Least-energy way of every candidate arc, by (from, to); pairs without a way are left out."""
    travel, fleet = Travel(problem, roads_of(problem, snapshot)), problem.fleet
    wanted = sorted({pair for vehicle in fleet.vehicles for pair in fleet.legs(vehicle)})
    legs = {pair: travel.leg(*pair) for pair in wanted}
    return {pair: leg for pair, leg in legs.items() if leg is not None}


def leg_along(roads: Roads, way: Sequence[int], start: str, end: str, style: DrivingStyle) -> Leg:
    """The leg along given segments (indices into ``roads.ids``)."""
    rows = np.array(way)
    return Leg(
        start,
        end,
        tuple(roads.ids[i] for i in way),
        float(roads.cost_kwh[rows].sum()),
        plan_drive(roads.length_m[rows].tolist(), roads.speed_mps[rows].tolist(), style),
    )


def _change_s(before_mps: Floats, after_mps: Floats, style: DrivingStyle) -> Floats:
    """Time lost in changing from one speed to another, against an instant change, s.

    Δv²/2av for gaining speed at rate a within the faster segment, likewise for losing it.
    """
    gain = np.maximum(after_mps - before_mps, 0.0)
    loss = np.maximum(before_mps - after_mps, 0.0)
    return np.asarray(
        gain**2 / (2 * style.acceleration_mps2 * np.maximum(after_mps, _FEWEST_S))
        + loss**2 / (2 * style.braking_mps2 * np.maximum(before_mps, _FEWEST_S))
    )
