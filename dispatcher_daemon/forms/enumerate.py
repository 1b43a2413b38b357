"""Energies of all states of a QUBO."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

MAX_VARIABLES = 30
BLOCK_BITS = 18


def energies_of(
    h: npt.NDArray[np.float64],
    coupling: npt.NDArray[np.float64],
    offset: float,
    block_bits: int = BLOCK_BITS,
) -> Iterator[npt.NDArray[np.float64]]:
    """Energies of all 2^n states of a QUBO, in blocks of 2^min(n, block_bits), by doubling.

    State s sets variable i to bit i of s; blocks come in the order of s. With variable i added to
    states of the i before it, E(2^i + s) = E(s) + h_i + Σ_{j<i} J_ij s_j, so a state costs two
    additions.

    Args:
        h: biases, shape (n,).
        coupling: symmetric, without a diagonal, shape (n, n).

    Raises:
        ValueError: more than `MAX_VARIABLES` variables.
    """
    n = len(h)
    if n > MAX_VARIABLES:
        raise ValueError(f"{n} variables are too many to enumerate, the most is {MAX_VARIABLES}")
    return _blocks(h, coupling, offset, min(n, block_bits))


def _blocks(
    h: npt.NDArray[np.float64], coupling: npt.NDArray[np.float64], offset: float, low: int
) -> Iterator[npt.NDArray[np.float64]]:
    n = len(h)
    fields = [_sums(coupling[i, :i]) for i in range(low)]
    energies = np.empty(1 << low)
    for high in range(1 << (n - low)):
        on = low + np.flatnonzero([(high >> bit) & 1 for bit in range(n - low)])
        energies[0] = offset + h[on].sum() + coupling[np.ix_(on, on)].sum() / 2
        linear = h[:low] + coupling[:low, on].sum(axis=1)
        for i in range(low):
            size = 1 << i
            np.add(energies[:size], fields[i], out=energies[size : 2 * size])
            energies[size : 2 * size] += linear[i]
        yield energies.copy()


def _sums(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Sum of the values that each bit pattern selects, shape (2^len(values),)."""
    sums = np.zeros(1)
    for value in values:
        sums = np.concatenate([sums, sums + value])
    return sums
