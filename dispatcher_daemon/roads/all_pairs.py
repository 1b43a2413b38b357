"""Least-cost paths from some junctions to all of them, and sums along these paths.

A search's distances are many times larger than what is kept of it, so it takes some origins at a
time. Of each origin and segment one small number is kept: which turn onto the segment its path
takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.roads.arrays import Roads
from dispatcher_daemon.roads.weights import Floats, Weights

_SEARCHED_AT_ONCE: Final = 1_000_000
"""Distances that a search holds at a time, 8 MB of them, beside a dozen arrays of that size."""

Ints32 = npt.NDArray[np.int32]
Ranks = npt.NDArray[np.unsignedinteger[Any]]
"""Of turns among those onto one segment; one more than the largest: none, a path begins there."""


class AllPairs:
    """Least-cost paths between some junctions.

    Attributes:
        last: last segment of the path from junction i to junction j, -1 where there is none, shape
            (n, n).
    """

    def __init__(self, roads: Roads, searched: Weights, nodes: Sequence[str]) -> None:
        """Nothing is searched yet.

        Args:
            searched: what paths minimise.
            nodes: the junctions.
        """
        self._roads, self._searched, self._nodes = roads, searched, nodes
        m, n, count = len(roads.ids), len(nodes), roads.turn.shape[1]
        order = np.argsort(roads.turn[1], kind="stable")
        onto = roads.turn[1, order]
        rank = np.arange(count) - np.searchsorted(onto, onto, "left")
        self._none = int(rank.max(initial=-1)) + 1
        # By rank and segment: the segment that the turn comes from, and the turn. One more segment,
        # m, stands for the start.
        self._origin = np.full((self._none + 1, m), m, dtype=np.int32)
        self._turn = np.zeros((self._none + 1, m), dtype=np.int64)
        self._origin[rank, onto], self._turn[rank, onto] = roads.turn[0, order], order
        self._rank: Ranks = np.empty((n, m), dtype=np.min_scalar_type(self._none))
        self.last: Ints32 = np.empty((n, n), dtype=np.int32)

    def search(self, kinds: Sequence[Weights]) -> list[Floats]:
        """Costs of each kind along the paths; inf where there is none, shape (n, n)."""
        n = len(self._nodes)
        found = [np.empty((n, n)) for _ in kinds]
        for rows in self._searched_rows():
            for whole, part in zip(found, self.along(rows, kinds), strict=True):
                whole[rows] = part
        return found

    def path(self, i: int, j: int) -> list[int]:
        """Segments of the path between two junctions that one leads between."""
        path = [int(self.last[i, j])]
        while self._rank[i, path[-1]] != self._none:
            path.append(int(self._origin[self._rank[i, path[-1]], path[-1]]))
        return path[::-1]

    def _searched_rows(self) -> Iterator[slice]:
        """Search from some origins at a time."""
        roads, cost, nodes = self._roads, self._searched, self._nodes
        m, n = len(roads.ids), len(nodes)
        out = [roads.leaving[node] for node in nodes]
        onto = np.concatenate([roads.turn[1], *(np.array(o, dtype=np.int64) for o in out)])
        start = np.repeat(np.arange(m, m + n), [len(o) for o in out])
        graph = csr_array(
            (
                np.concatenate([cost.turn, *(cost.entry[o] for o in out)]),
                (np.concatenate([roads.turn[0], start]), onto),
            ),
            shape=(m + n, m + n),
        )
        # Segments into each junction; none is nearer than one that does not exist, m.
        into = [roads.entering[node] for node in nodes]
        ends = np.full((n, max([1, *map(len, into)])), m)
        for j, segments in enumerate(into):
            ends[j, : len(segments)] = segments
        finish = np.append(cost.finish, np.inf)
        step = max(1, _SEARCHED_AT_ONCE // (m + n))
        for first in range(0, n, step):
            rows = slice(first, min(first + step, n))
            distance, before = dijkstra(
                graph, indices=np.arange(m + rows.start, m + rows.stop), return_predecessors=True
            )
            rank = self._rank[rows]
            rank[:] = self._none
            # Not to be taken for the missing turns of `_origin`.
            before[before >= m] = -1
            for number, origin in enumerate(self._origin[: self._none]):
                rank[before[:, :m] == origin] = number
            distance[:, m] = np.inf
            best = np.full((len(rank), n), -1, dtype=np.int32)
            least = np.full((len(rank), n), np.inf)
            for choice in ends.T:
                whole = distance[:, choice] + finish[choice]
                better = whole < least
                least[better] = whole[better]
                best[better] = np.broadcast_to(choice, whole.shape)[better]
            best[np.arange(len(rank)), np.arange(rows.start, rows.stop)] = -1
            self.last[rows] = best
            yield rows

    def along(self, rows: slice, kinds: Sequence[Weights]) -> Iterator[Floats]:
        """Costs of each kind from some origins to all junctions, summed along the paths found,
        shape (rows, n); inf where there is none.
        """
        rank, last = self._rank[rows], self.last[rows]
        count, m = rank.shape
        # The start costs nothing and precedes itself.
        at = rank.astype(np.int64) * m + np.arange(m)
        before = np.full((count, m + 1), m, dtype=np.int64)
        before[:, :m] = self._origin.ravel()[at]
        sums = []
        for w in kinds:
            step_kwh = np.append(w.turn, 0.0)[np.minimum(self._turn, len(w.turn))]
            step_kwh[self._none] = w.begin
            sums.append(np.zeros((count, m + 1)))
            sums[-1][:, :m] = step_kwh.ravel()[at]
        row = (m + 1) * np.arange(count)[:, None]
        # Each round doubles how much of a path its last segment stands for.
        while (before != m).any():
            here = before + row
            for values in sums:
                values += values.ravel()[here]
            before = before.ravel()[here]
        paths = last >= 0
        ends = np.where(paths, last, m)
        for values, w in zip(sums, kinds, strict=True):
            total = np.take_along_axis(values, ends, axis=1) + np.append(w.finish, 0.0)[ends]
            total[~paths] = np.inf
            yield total
