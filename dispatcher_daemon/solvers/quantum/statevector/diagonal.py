"""The diagonal of a cost Hamiltonian: the energy of every state that a simulation holds."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import energies_of
from dispatcher_daemon.solvers.quantum.ising import Ising

Diagonal = npt.NDArray[np.float32]
"""C of each state in single precision, shape (states,)."""

MAX_QUBITS = 27
MAX_ONE_HOT_STATES = 1 << 20
_CHUNK = 1 << 14


def cost_diagonal(ising: Ising) -> Diagonal:
    """C of all 2^n states, by doubling in double precision; qubit 0 is the least significant bit.

    4 · 2^n bytes: 128 MiB at 25 qubits.

    Raises:
        ValueError: more than `MAX_QUBITS` qubits.
    """
    n = len(ising.h)
    if n > MAX_QUBITS:
        raise ValueError(f"{n} qubits are too many for a state vector, the most is {MAX_QUBITS}")
    # z = 1 − 2x
    linear = -2 * (ising.h + ising.coupling.sum(axis=1))
    offset = ising.offset + ising.h.sum() + ising.coupling.sum() / 2
    diagonal = np.empty(1 << n, dtype=np.float32)
    first = 0
    for block in energies_of(linear, 4 * ising.coupling, float(offset)):
        diagonal[first : first + len(block)] = block
        first += len(block)
    return diagonal


def one_hot_diagonal(ising: Ising, groups: Sequence[Sequence[int]]) -> Diagonal:
    """C of all states with one qubit of each group in |1⟩; numbered as by `one_hot_bits`.

    Raises:
        ValueError: more than `MAX_ONE_HOT_STATES` states.
    """
    count = prod(len(group) for group in groups)
    if count > MAX_ONE_HOT_STATES:
        raise ValueError(f"{count} one-hot states are too many, the most is {MAX_ONE_HOT_STATES}")
    diagonal = np.empty(count, dtype=np.float32)
    for first in range(0, count, _CHUNK):
        states = np.arange(first, min(first + _CHUNK, count))
        z = 1.0 - 2.0 * one_hot_bits(states, groups, len(ising.h))
        diagonal[states] = ising.offset + z @ ising.h + ((z @ ising.coupling) * z).sum(axis=1) / 2
    return diagonal


def standardised(diagonal: Diagonal) -> Diagonal:
    """Less its mean and divided by its standard deviation, so that one set of angles fits all.

    For one-hot states, which differ little: the largest coefficient, a penalty's, is no measure of
    their spread. Equal energies become 0.
    """
    energies = diagonal.astype(np.float64)
    energies -= energies.mean()
    spread = float(energies.std())
    # Rounding leaves some spread where there is none.
    if spread <= 1e-6 * float(np.abs(diagonal).max(initial=0.0)):
        return np.zeros_like(diagonal)
    return (energies / spread).astype(np.float32)


def one_hot_bits(
    states: npt.NDArray[np.int64], groups: Sequence[Sequence[int]], width: int
) -> npt.NDArray[np.int8]:
    """Bits by qubit, shape (states, width), of numbers in mixed radix; the first group counts ones.

    Digit d of a group is its d-th qubit in |1⟩.
    """
    bits = np.zeros((len(states), width), dtype=np.int8)
    rows, rest = np.arange(len(states)), np.asarray(states)
    for group in groups:
        rest, digit = np.divmod(rest, len(group))
        bits[rows, np.asarray(group)[digit]] = 1
    return bits
