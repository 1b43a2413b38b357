"""Costs of paths over segments, as sums over their turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import yen

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MIN_COST = 1e-12
"""Lower bound of each part of a path; sparse graphs have no edges of cost 0."""
_MIN_SHARE = 0.01


@dataclass(frozen=True)
class Weights:
    """A path over segments a, b, c costs begin[a] + turn[a → b] + turn[b → c] + finish[c].

    Attributes:
        turn: of each turn, > 0, shape (t,).
        begin: of each segment as the first one of a path, shape (m,).
        finish: of each segment as the last one, ≥ 0, shape (m,).
        on_exit: True if a segment's cost is part of the turn that leaves it, and of the finish for
            the last one; False if it is part of the turn that enters it, and of the begin for the
            first one.
    """

    turn: Floats
    begin: Floats
    finish: Floats
    on_exit: bool = False

    @property
    def entry(self) -> Floats:
        """`begin` raised by one number to be > 0, as searches need it; a path has one begin."""
        lowest = self.begin.min(initial=MIN_COST)
        return self.begin if lowest >= MIN_COST else self.begin - lowest + MIN_COST

    def plus(self, other: Weights, times: float) -> Weights:
        """The sum of this and ``times`` another one with the same `on_exit`."""
        return Weights(
            self.turn + times * other.turn,
            self.begin + times * other.begin,
            self.finish + times * other.finish,
            self.on_exit,
        )

    def discounted(self, discount: Floats, pairs: Ints) -> Weights:
        """With each segment cheaper by its discount, shape (m,); 1 % of a cost is left at least.

        Args:
            pairs: segments of each turn (from, onto), shape (2, t).
        """
        if self.on_exit:
            turn = _discounted(self.turn, discount[pairs[0]])
            return Weights(turn, self.begin, _discounted(self.finish, discount), True)
        turn = _discounted(self.turn, discount[pairs[1]])
        return Weights(turn, _discounted(self.begin, discount), self.finish)

    def along(self, path: Sequence[int], turns: Sequence[int]) -> float:
        """Cost of one path.

        Args:
            turns: numbers of the turns between them.
        """
        parts = np.concatenate([self.begin[[path[0]]], self.turn[list(turns)]])
        return float(parts.sum() + self.finish[path[-1]])


def _discounted(cost: Floats, discount: Floats) -> Floats:
    return np.asarray(np.maximum(cost - discount, _MIN_SHARE * cost))


def k_shortest_paths(
    pairs: Ints, weights: Weights, first: Sequence[int], last: Sequence[int], max_paths: int
) -> list[list[int]]:
    """The k cheapest loopless paths between two sets of segments, k = ``max_paths`` (Yen, 1971).

    Args:
        pairs: segments of each turn (from, onto), shape (2, t).
    """
    m = len(weights.begin)
    # Segments, then the start and the end, which may cost nothing: 0 would be no edge.
    rows = np.concatenate([pairs[0], np.full(len(first), m), last])
    columns = np.concatenate([pairs[1], first, np.full(len(last), m + 1)])
    ends = np.maximum(weights.finish[last], MIN_COST)
    cost = np.concatenate([weights.turn, weights.entry[first], ends])
    graph = csr_array((cost, (rows, columns)), shape=(m + 2, m + 2))
    # scipy's yen takes 32-bit indices only.
    graph.indices, graph.indptr = graph.indices.astype(np.int32), graph.indptr.astype(np.int32)
    _, before = yen(graph, m, m + 1, max_paths, return_predecessors=True)
    found = []
    for row in before:
        path = [int(row[m + 1])]
        while row[path[-1]] != m:
            path.append(int(row[path[-1]]))
        found.append(path[::-1])
    return found
