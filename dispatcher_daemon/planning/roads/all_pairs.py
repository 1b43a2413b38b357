"""Least-cost paths from some junctions to all of them, and sums along these paths.

A search's distances are many times larger than what is kept of it, so it takes some origins at a
time. Of each origin and segment one small number is kept: which turn onto the segment its path
takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.planning.roads.arrays import Roads
from dispatcher_daemon.planning.roads.weights import Floats, Ints, Weights

_SEARCHED_AT_ONCE: Final = 1_000_000
"""Distances that a search holds at a time, 8 MB of them, beside some arrays of that size."""
_SUMMED_AT_ONCE: Final = 100_000
"""Values that sums along paths hold at a time: in a processor's own cache they take a third."""

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

    def search(
        self, kinds: Sequence[Weights], may_go_on: Callable[[float], bool] = lambda _: True
    ) -> list[Floats]:
        """Costs of each kind along the paths; inf where there is none, shape (n, n).

        Args:
            may_go_on: asked before more origins are searched, with the share of them that is done.

        Raises:
            TimeoutError: it may not; there are no paths then.
        """
        n = len(self._nodes)
        found = [np.empty((n, n)) for _ in kinds]
        for rows in self._searched_rows():
            for whole, part in zip(found, self.along(kinds, rows), strict=True):
                whole[rows] = part
            if rows.stop < n and not may_go_on(rows.stop / n):
                raise TimeoutError(f"{rows.stop} of {n} junctions searched in time")
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

    def along(self, kinds: Sequence[Weights], rows: slice = slice(None)) -> list[Floats]:
        """Costs of each kind along the paths from some origins, shape (rows, n); inf: no path."""
        m, n = self._rank.shape[1], len(self._nodes)
        first, last, _ = rows.indices(n)
        steps_kwh = []
        for w in kinds:
            step_kwh = np.append(w.turn, 0.0)[np.minimum(self._turn, len(w.turn))]
            step_kwh[self._none] = w.begin
            steps_kwh.append(step_kwh.ravel())
        finishes = [np.append(w.finish, 0.0) for w in kinds]
        found = [np.empty((last - first, n)) for _ in kinds]
        step = max(1, _SUMMED_AT_ONCE // (m + 1))
        for at in range(first, last, step):
            part = slice(at, min(at + step, last))
            sums, ends = self._summed(part, steps_kwh)
            for whole, values, finish in zip(found, sums, finishes, strict=True):
                total = np.take_along_axis(values, ends, axis=1) + finish[ends]
                total[self.last[part] < 0] = np.inf
                whole[part.start - first : part.stop - first] = total
        return found

    def _summed(self, rows: slice, steps: Sequence[Floats]) -> tuple[list[Floats], Ints]:
        """(what paths cost up to each segment, by kind, shape (rows, m + 1); the last segments of
        those to each junction, m where there is none, shape (rows, n)).

        Args:
            steps: costs by rank and segment, of each kind.
        """
        rank, last = self._rank[rows], self.last[rows]
        count, m = rank.shape
        at = rank.astype(np.int64) * m + np.arange(m)
        # The start costs nothing and precedes itself.
        start = (m + 1) * np.arange(count)[:, None] + m
        before = np.repeat(start, m + 1, axis=1)
        before[:, :m] += self._origin.ravel()[at] - m
        sums = [np.zeros((count, m + 1)) for _ in steps]
        for values, step in zip(sums, steps, strict=True):
            values[:, :m] = step[at]
        further, more = np.empty_like(before), np.empty((count, m + 1))
        # Each round doubles how much of a path its last segment stands for.
        while (before != start).any():
            for values in sums:
                # All are within bounds: "clip" only saves that a copy is made first.
                np.take(values, before, out=more, mode="clip")
                values += more
            np.take(before, before, out=further, mode="clip")
            before, further = further, before
        return sums, np.where(last >= 0, last, m)
