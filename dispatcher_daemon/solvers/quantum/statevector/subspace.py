"""QAOA with an XY mixer, on the states that have one qubit of each group in |1⟩.

A mixer that keeps the number of ones of each group never leaves them: 5 · 5 · 5 · 5 · 5 = 3,125
states instead of 2^25. Within a group XXPlusYY(β) on a pair of qubits is the 2 × 2 rotation
[[cos β/2, −i sin β/2], [−i sin β/2, cos β/2]] between "one here" and "one there".
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.statevector.diagonal import Diagonal, one_hot_bits
from dispatcher_daemon.solvers.quantum.statevector.exact_state import ExactState, Schedule, States


def mixer_pairs(size: int) -> list[tuple[int, int]]:
    """Pairs of a group in the order of their gates: even, odd, and what closes the ring."""
    pairs = [(q, q + 1) for first in (0, 1) for q in range(first, size - 1, 2)]
    return [*pairs, (size - 1, 0)] if size > 2 else pairs


def one_hot_states(groups: Sequence[Sequence[int]]) -> int:
    """Number of states with one qubit of each group in |1⟩."""
    return math.prod(len(group) for group in groups)


class OneHotState(ExactState):
    """State of the product of one-hot groups, at first all choices equally likely (W states).

    A layer is e^{−iγC}, then in each group XXPlusYY(−2β) on the `mixer_pairs` in turn: the sign
    goes with that of the transverse mixer e^{+iβΣX}, as C is to be minimised.

    Args:
        diagonal: C of each state, by `one_hot_diagonal`.
        groups: qubits of each group; together all qubits, each once.
    """

    def __init__(self, diagonal: Diagonal, groups: Sequence[Sequence[int]]) -> None:
        super().__init__(diagonal, len(diagonal))
        self._groups = [list(group) for group in groups]
        # The first group counts ones, so that its axis is the last one.
        self._sizes = [len(group) for group in reversed(self._groups)]
        if one_hot_states(self._groups) != len(diagonal):
            raise ValueError("groups and diagonal of different sizes")
        amplitude = 1 / math.sqrt(len(diagonal))
        self._start = np.full(self._sizes, amplitude, dtype=np.complex128)
        self._state = self._start.ravel()

    def evolve(self, schedule: Schedule) -> None:
        """See `ExactState`; without layers the state is the first one."""
        state = self._start
        energies = self.diagonal.astype(np.float64).reshape(self._sizes)
        for beta, gamma in schedule:
            state = np.exp(-1j * gamma * energies) * state
            mixers = {size: _mixer(size, beta) for size in set(self._sizes)}
            for axis, size in enumerate(self._sizes):
                state = np.moveaxis(np.tensordot(mixers[size], state, (1, axis)), 0, axis)
        self._state = np.ascontiguousarray(state).ravel()

    def probabilities(self, first: int, last: int) -> npt.NDArray[np.float32]:
        """See `ExactState`."""
        part = self._state[first:last]
        return (part.real**2 + part.imag**2).astype(np.float32)

    def amplitudes(self) -> npt.NDArray[np.complex128]:
        """The state itself, shape (states,)."""
        return self._state.copy()

    def bits(self, states: States) -> npt.NDArray[np.int8]:
        """See `ExactState`."""
        return one_hot_bits(states, self._groups, sum(self._sizes))


def _mixer(size: int, beta: float) -> npt.NDArray[np.complex128]:
    """Product of a group's gates between its one-hot states, shape (size, size)."""
    unitary = np.eye(size, dtype=np.complex128)
    c, s = math.cos(beta), 1j * math.sin(beta)
    for a, b in mixer_pairs(size):
        unitary[[a, b]] = c * unitary[a] + s * unitary[b], s * unitary[a] + c * unitary[b]
    return unitary
