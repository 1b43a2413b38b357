"""Bit distributions that need no circuit, as controls of quantum samplers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

_TOLERANCE = 1e-6


@dataclass(frozen=True)
class BitDistribution:
    """Independent bits, and independent groups of bits of which exactly one is 1.

    Attributes:
        probabilities: P(x_i = 1) by variable of the model, shape (n,).
        groups: disjoint sets of variables with one 1 each; their probabilities sum to 1.
    """

    probabilities: tuple[float, ...]
    groups: tuple[tuple[int, ...], ...] = ()

    def __post_init__(self) -> None:
        if not all(0 <= p <= 1 for p in self.probabilities):
            raise ValueError("a probability is from 0 to 1")
        members = [i for group in self.groups for i in group]
        if len(set(members)) < len(members) or not set(members) <= set(range(len(self))):
            raise ValueError("groups must be disjoint sets of variables")
        for group in self.groups:
            if abs(sum(self.probabilities[i] for i in group) - 1) > _TOLERANCE:
                raise ValueError("the probabilities of a group must sum to 1")

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


def uniform_bits(n: int) -> BitDistribution:
    """Independent bits with P(1) = 0.5."""
    return BitDistribution((0.5,) * n)


def uniform_choices(n: int, groups: Sequence[Sequence[int]]) -> BitDistribution:
    """One member of each group, all equally likely; bits outside the groups have P(1) = 0.5."""
    probabilities = [0.5] * n
    for group in groups:
        for i in group:
            probabilities[i] = 1 / len(group)
    return BitDistribution(tuple(probabilities), tuple(tuple(group) for group in groups))
