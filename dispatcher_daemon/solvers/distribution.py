"""Bit distributions that need no circuit, as controls of quantum samplers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class BitDistribution:
    """Independent bits, and independent groups of bits of which exactly one is 1.

    Attributes:
        probabilities: P(x_i = 1) by variable of the model, shape (n,).
        groups: disjoint sets of variables with one 1 each; their probabilities sum to 1.
    """

    probabilities: tuple[float, ...]
    groups: tuple[tuple[int, ...], ...] = ()

    def __len__(self) -> int:
        return len(self.probabilities)

    def sample(self, shots: int, seed: int) -> npt.NDArray[np.int8]:
        """Samples as rows of bits, shape (shots, n)."""
        rng = np.random.default_rng(seed)
        bits = (rng.random((shots, len(self))) < np.array(self.probabilities)).astype(np.int8)
        for group in self.groups:
            index = np.array(group)
            edges = np.cumsum(np.array(self.probabilities)[index])
            # The last edge may be a rounding error below 1.
            drawn = np.minimum(np.searchsorted(edges, rng.random(shots), "right"), len(index) - 1)
            bits[:, index] = 0
            bits[np.arange(shots), index[drawn]] = 1
        return bits
