"""Alternative paths of legs by the present traffic, before they begin and on the road."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.roads import Roads
from slipstream.roads import RoadNetwork

Path = tuple[str, ...]

_MIN_IMPROVEMENT: Final = 0.02
"""Smallest relative improvement of another path, against oscillation."""


class AlternativeRoutes:
    """Least-cost paths under the traffic of one moment.

    Args:
        network: whose roads they are.
        roads: with their costs.
    """

    def __init__(self, network: RoadNetwork, roads: Roads) -> None:
        self._network, self._roads = network, roads
        m = len(roads.ids)
        self._graph = csr_array((roads.objective.turn, tuple(roads.turn)), shape=(m, m))

    def better(self, path: Path, driven: int | None = None) -> Path | None:
        """A path to the same place with a clearly lower cost; None if there is none.

        Args:
            path: of the leg.
            driven: number of the segment that the vehicle is on; None: it has not begun. The next
                one stays as it is: its lane may be chosen already.
        """
        index = self._roads.index
        if driven is None:
            first = self._network.segments[path[0]].start
            kept, sources = 0, list(self._roads.leaving[first])
        else:
            kept = driven + 1
            if kept >= len(path) - 1:
                return None
            sources = [index[path[kept]]]
        found = self._least_cost(sources, self._network.segments[path[-1]].end, driven is None)
        if found is None:
            return None
        present = [index[name] for name in path[kept:]]
        cost = self._roads.cost(self._roads.objective, found)
        if cost > (1 - _MIN_IMPROVEMENT) * self._roads.cost(self._roads.objective, present):
            return None
        return (*path[:kept], *(self._roads.ids[i] for i in found))

    def _least_cost(self, sources: Sequence[int], end: str, begins: bool) -> list[int] | None:
        """Segments from one of some to a junction."""
        objective = self._roads.objective
        into = self._roads.entering[end]
        distance, before = dijkstra(self._graph, indices=sources, return_predecessors=True)
        whole = distance[:, into] + objective.finish[into]
        if begins:
            whole += objective.begin[list(sources)][:, None]
        if not np.isfinite(whole).any():
            return None
        row, column = np.unravel_index(int(whole.argmin()), whole.shape)
        way = [into[int(column)]]
        while way[-1] != sources[int(row)]:
            way.append(int(before[row, way[-1]]))
        return way[::-1]
