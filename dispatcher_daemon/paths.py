"""Least-cost paths over road segments, with the turns that the network allows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from slipstream.roads import RoadNetwork

Path = tuple[str, ...]


def least_cost_paths(
    network: RoadNetwork,
    cost: Mapping[str, float],
    sources: Sequence[str],
    targets: Sequence[str],
) -> dict[tuple[str, str], Path]:
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
        connect(index[name], dict.fromkeys(turns(network, name)))
    for i, source in enumerate(sources):
        connect(len(ids) + i, (segment.id for segment in network.leaving[source]))

    size = len(ids) + len(sources)
    graph = csr_array((weights, (rows, columns)), shape=(size, size))
    starts = np.arange(len(ids), size)
    distance, before = dijkstra(graph, indices=starts, return_predecessors=True)

    entering: dict[str, list[int]] = {}
    for name in ids:
        entering.setdefault(network.segments[name].end, []).append(index[name])
    found: dict[tuple[str, str], Path] = {}
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


def turns(network: RoadNetwork, segment: str) -> tuple[str, ...]:
    """Segments that a vehicle may drive on into without stopping; all where nothing is known."""
    known = network.follows.get(segment)
    if known is not None:
        return known
    return tuple(s.id for s in network.leaving[network.segments[segment].end])
