"""Arc problems of any size for counting: every arc a candidate, every reward that there can be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.fleet import DEPOT
from dispatcher_daemon.forms import ArcProblem, ArcReward, CandidateArc
from slipstream.energy.consumption import steady_energy_kwh
from slipstream.roads import RoadNetwork, Segment, build_network

SIDE: Final = 11
"""Streets in each direction of the grid: 121 junctions, 440 segments."""


@dataclass(frozen=True)
class ScalingCase:
    """N customers and K vehicles on one street network, every arc a candidate.

    Every segment is stable and everybody in time for everybody else: as many rewards as there can
    be. Legs are (from, to) pairs of places in a fixed order; vehicle k's arcs are the k-th part of
    the problem's, in that order.

    Attributes:
        problem: the arc problem without rewards.
        segments: number of road segments.
        shared: which legs share a segment, boolean, shape (legs, legs), symmetric.
    """

    problem: ArcProblem
    segments: int
    shared: csr_array

    @cached_property
    def legs(self) -> int:
        """Number of candidate arcs of one vehicle."""
        return int(self.shared.shape[0])

    def rewarded(self, saving_kwh: float = 1e-3) -> ArcProblem:
        """The problem with all rewards written out; for small cases only."""
        rows, columns = self.shared.nonzero()
        vehicles, legs = len(self.problem.vehicles), self.legs
        rewards = tuple(
            ArcReward(k * legs + int(a), m * legs + int(b), "shared", saving_kwh)
            for k in range(vehicles)
            for m in range(k + 1, vehicles)
            for a, b in zip(rows, columns, strict=True)
        )
        problem = self.problem
        return ArcProblem(problem.depot, problem.customers, problem.vehicles, problem.arcs, rewards)


def scaling_case(customers: int, vehicles: int, side: int = SIDE, seed: int = 1) -> ScalingCase:
    """Customers and depot at junctions of their own in a grid of streets.

    Args:
        side: streets in each direction.
        seed: of the lengths of streets and of who is where.

    Raises:
        ValueError: fewer junctions than places, or more vehicles than customers: each has to drive.
    """
    if not 1 <= vehicles <= customers:
        raise ValueError(f"{vehicles} vehicles need 1 to {customers} customers: each has to drive")
    rng = np.random.default_rng(seed)
    network = _grid(rng, side)
    junctions = sorted(network.junctions)
    if customers >= len(junctions):
        raise ValueError(f"{len(junctions)} junctions are too few for {customers} customers")
    nodes = [str(name) for name in rng.choice(junctions, customers + 1, replace=False)]
    cost = {
        name: steady_energy_kwh(segment.length_m, segment.speed_limit_mps)
        for name, segment in network.segments.items()
    }
    paths = least_cost_paths(network, cost, nodes, nodes)
    places = {node: DEPOT if i == 0 else f"c{i}" for i, node in enumerate(nodes)}
    legs = sorted(paths)
    index = {name: i for i, name in enumerate(sorted(network.segments))}
    where = [(row, index[name]) for row, leg in enumerate(legs) for name in paths[leg]]
    rows, columns = zip(*where, strict=True)
    over = csr_array(
        (np.ones(len(where), dtype=np.int32), (rows, columns)), shape=(len(legs), len(index))
    )
    fleet = tuple(f"v{k}" for k in range(vehicles))
    arcs = tuple(
        CandidateArc(k, places[i], places[j], sum(cost[name] for name in paths[i, j]))
        for k in fleet
        for i, j in legs
    )
    problem = ArcProblem(DEPOT, tuple(places.values())[1:], fleet, arcs)
    return ScalingCase(problem, len(index), (over @ over.T).astype(bool))


def _grid(rng: np.random.Generator, side: int) -> RoadNetwork:
    """Streets at 50 km/h; each stretch has a length of its own, so that paths are unique."""
    cells = [(row, column) for row in range(side) for column in range(side)]
    names = {cell: f"{cell[0]:02d}-{cell[1]:02d}" for cell in cells}
    places = {names[row, column]: (200.0 * column, 200.0 * row) for row, column in cells}
    segments = []
    for row, column in cells:
        for end in ((row, column + 1), (row + 1, column)):
            if end in names:
                length = float(rng.uniform(200.0, 260.0))
                pair = names[row, column], names[end]
                segments += [
                    Segment(f"{i}>{j}", i, j, length, 13.89, 1, (places[i], places[j]))
                    for i, j in (pair, pair[::-1])
                ]
    return build_network(f"grid-{side}", segments, places)


def least_cost_paths(
    network: RoadNetwork,
    cost: Mapping[str, float],
    sources: Sequence[str],
    targets: Sequence[str],
) -> dict[tuple[str, str], tuple[str, ...]]:
    """Cheapest path from every source to every other target.

    The search runs over segments, not junctions, so that a forbidden turn is never taken. A path
    may start with any segment that leaves its source: a vehicle that has stopped there can leave
    either way.

    Args:
        cost: cost of each segment, > 0, by segment id.
        sources: junctions.
        targets: junctions.

    Returns:
        Segment ids by (source, target); unreachable pairs and source = target are left out.
    """
    ids = sorted(network.segments)
    index = {name: i for i, name in enumerate(ids)}
    rows: list[int] = []
    columns: list[int] = []
    weights: list[float] = []

    def connect(row: int, names: Iterable[str]) -> None:
        for name in names:
            rows.append(row)
            columns.append(index[name])
            weights.append(cost[name])

    for name in ids:
        connect(index[name], dict.fromkeys(network.turns(name)))
    for i, source in enumerate(sources):
        connect(len(ids) + i, (segment.id for segment in network.leaving[source]))

    size = len(ids) + len(sources)
    graph = csr_array((weights, (rows, columns)), shape=(size, size))
    starts = np.arange(len(ids), size)
    distance, before = dijkstra(graph, indices=starts, return_predecessors=True)

    entering: dict[str, list[int]] = {}
    for name in ids:
        entering.setdefault(network.segments[name].end, []).append(index[name])
    found: dict[tuple[str, str], tuple[str, ...]] = {}
    for i, source in enumerate(sources):
        for target in targets:
            last = min(entering.get(target, ()), key=lambda j: float(distance[i, j]), default=None)
            if target == source or last is None or not np.isfinite(distance[i, last]):
                continue
            path: list[str] = []
            while last < len(ids):
                path.append(ids[last])
                last = int(before[i, last])
            found[source, target] = tuple(reversed(path))
    return found
