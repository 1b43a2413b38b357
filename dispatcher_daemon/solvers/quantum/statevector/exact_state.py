"""Mean energy, probabilities and samples of an exactly simulated QAOA state.

The state is processed in blocks, as the probabilities of 25 qubits at once would take as much
memory as the state.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.statevector.diagonal import Diagonal

Schedule = Sequence[tuple[float, float]]
"""(β, γ) of each layer: e^{−iγC}, then the mixer with β."""

States = npt.NDArray[np.int64]

_T = TypeVar("_T")


class ExactState(ABC):
    """A state over numbered basis states, each with its energy.

    Attributes:
        diagonal: C of each state.
        threads: number of parallel threads.
    """

    def __init__(self, diagonal: Diagonal, block: int, threads: int = 1) -> None:
        self.diagonal = diagonal
        self.threads = threads
        self._block = block

    @abstractmethod
    def evolve(self, schedule: Schedule) -> None:
        """Become the state that the schedule makes of the initial one."""

    @abstractmethod
    def probabilities(self, first: int, last: int) -> npt.NDArray[np.float32]:
        """Of the states first..last − 1, as rounded: their sum is 1 within 1e-4."""

    @abstractmethod
    def bits(self, states: States) -> npt.NDArray[np.int8]:
        """Bits by qubit, shape (states, qubits)."""

    def norm(self) -> float:
        """Σ p, accumulated in double precision."""
        return float(self._block_sums(lambda p, first: float(p.sum(dtype=np.float64))).sum())

    def mean(self) -> float:
        """⟨C⟩, of the state scaled to norm 1."""

        def sums(p: npt.NDArray[np.float32], first: int) -> tuple[float, float]:
            weighted = np.dot(p, self.diagonal[first : first + len(p)])
            return float(p.sum(dtype=np.float64)), float(weighted)

        mass, weighted = self._block_sums(sums).sum(axis=0)
        return float(weighted / mass)

    def probability_of(self, states: States) -> npt.NDArray[np.float64]:
        """Probability of each of the given states, shape (states,); of few states."""
        found = np.empty(len(states))
        for block in np.unique(states // self._block):
            here = np.flatnonzero(states // self._block == block)
            first = int(block) * self._block
            p = self.probabilities(first, min(first + self._block, len(self.diagonal)))
            found[here] = p[states[here] - first]
        return found

    def sample(self, shots: int, seed: int) -> tuple[States, States]:
        """Distinct states in their order, and how often each was drawn."""
        reached = np.cumsum(self._block_sums(lambda p, first: float(p.sum(dtype=np.float64))))
        wanted = np.sort(np.random.default_rng(seed).random(shots)) * reached[-1]
        block = np.minimum(np.searchsorted(reached, wanted, side="right"), len(reached) - 1)
        drawn = np.empty(shots, dtype=np.int64)
        for number in np.unique(block):
            here = block == number
            first = int(number) * self._block
            p = self.probabilities(first, min(first + self._block, len(self.diagonal)))
            within = np.cumsum(p, dtype=np.float64)
            start = reached[number - 1] if number else 0.0
            at = np.searchsorted(within, wanted[here] - start, side="right")
            # Rounding must not draw a state of probability 0 behind the last one.
            drawn[here] = first + np.minimum(at, np.searchsorted(within, within[-1]))
        states, counts = np.unique(drawn, return_counts=True)
        return states, counts

    def _block_sums(
        self, work: Callable[[npt.NDArray[np.float32], int], float | tuple[float, ...]]
    ) -> npt.NDArray[np.float64]:
        return np.array(self._over_blocks(work))

    def _over_blocks(self, work: Callable[[npt.NDArray[np.float32], int], _T]) -> list[_T]:
        size = len(self.diagonal)

        def blocks(start: int, end: int) -> list[_T]:
            firsts = range(start * self._block, min(end * self._block, size), self._block)
            return [work(self.probabilities(f, min(f + self._block, size)), f) for f in firsts]

        parts = in_threads(blocks, -(-size // self._block), self.threads)
        return [result for part in parts for result in part]


def in_threads(work: Callable[[int, int], _T], count: int, threads: int) -> list[_T]:
    """Results of ``work(start, end)`` on equal parts of range(count), in order."""
    parts = min(threads, count)
    if parts <= 1:
        return [work(0, count)]
    bounds = [count * part // parts for part in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        return list(pool.map(work, bounds[:-1], bounds[1:]))
