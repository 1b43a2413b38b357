"""What ways over segments cost, put together from their turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import yen

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LEAST = 1e-12
"""No part of a way costs less: to the searches, 0 would be no way."""
_MIN_SHARE = 0.01


@dataclass(frozen=True)
class Weights:
    """A way over segments a, b, c costs begin[a] + turn[a → b] + turn[b → c] + finish[c].

    Attributes:
        turn: of each turn, > 0, shape (t,).
        begin: of each segment as the first one of a way, > 0, shape (m,).
        finish: of each segment as the last one, ≥ 0, shape (m,).
        behind: whether a turn pays for the segment that is left by it, and the finish for the last
            one; if not, it pays for the one that is driven onto, and the begin for the first one.
    """

    turn: Floats
    begin: Floats
    finish: Floats
    behind: bool = False

    def plus(self, other: Weights, times: float) -> Weights:
        """The sum of this and so many times another one of the same kind."""
        return Weights(
            self.turn + times * other.turn,
            self.begin + times * other.begin,
            self.finish + times * other.finish,
            self.behind,
        )

    def discounted(self, discount: Floats, pairs: Ints) -> Weights:
        """With each segment cheaper by its discount, shape (m,); 1 % of a cost is left at least.

        Args:
            pairs: segments of each turn (from, onto), shape (2, t).
        """
        if self.behind:
            turn = _less(self.turn, discount[pairs[0]])
            return Weights(turn, self.begin, _less(self.finish, discount), True)
        turn = _less(self.turn, discount[pairs[1]])
        return Weights(turn, _less(self.begin, discount), self.finish)

    def along(self, way: Sequence[int], turns: Sequence[int]) -> float:
        """Cost of one way.

        Args:
            way: its segments, at least one.
            turns: numbers of the turns between them.
        """
        parts = np.concatenate([self.begin[[way[0]]], self.turn[list(turns)]])
        return float(parts.sum() + self.finish[way[-1]])


def _less(cost: Floats, discount: Floats) -> Floats:
    return np.asarray(np.maximum(cost - discount, _MIN_SHARE * cost))


def cheapest_ways(
    pairs: Ints, weights: Weights, first: Sequence[int], last: Sequence[int], most: int
) -> list[list[int]]:
    """The cheapest ways without a loop from some segments to others, at most so many (Yen, 1971).

    Args:
        pairs: segments of each turn (from, onto), shape (2, t).
        first: segments that a way may begin with.
        last: segments that it may end with.
    """
    m = len(weights.begin)
    # Segments, then the start and the end, which may cost nothing: 0 would be no edge.
    rows = np.concatenate([pairs[0], np.full(len(first), m), last])
    columns = np.concatenate([pairs[1], first, np.full(len(last), m + 1)])
    ends = np.maximum(weights.finish[last], LEAST)
    cost = np.concatenate([weights.turn, weights.begin[first], ends])
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
