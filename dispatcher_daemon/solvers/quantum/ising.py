"""A QUBO as an Ising Hamiltonian in Qiskit's convention."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Ising:
    """C = offset + Σ h_i Z_i + Σ_{i<j} J_ij Z_i Z_j with x = (1 − z)/2.

    Qiskit's |1⟩ has z = −1, so that x = 1 is measured as 1. (dimod's spins have x = (1 + s)/2.)

    Attributes:
        h: fields, shape (n,).
        coupling: J, symmetric with a zero diagonal, shape (n, n).
        offset: energy that no state changes.
    """

    h: npt.NDArray[np.float64]
    coupling: npt.NDArray[np.float64]
    offset: float

    def normalised(self) -> Ising:
        """Divided by the largest |h| or |J|, so that one set of angles fits all instances."""
        largest = max(float(np.abs(self.h).max()), float(np.abs(self.coupling).max()))
        if largest == 0:
            return self
        return Ising(self.h / largest, self.coupling / largest, self.offset / largest)

    def permuted(self, order: Sequence[int]) -> Ising:
        """The same with qubit q carrying variable ``order[q]``."""
        index = np.asarray(order)
        return Ising(self.h[index], self.coupling[np.ix_(index, index)], self.offset)


def to_ising(bqm: Any, order: Sequence[Hashable]) -> Ising:
    """Convert a binary quadratic model; index i stands for ``order[i]``."""
    index = {name: i for i, name in enumerate(order)}
    linear, quadratic, offset = bqm.to_ising()
    h = np.zeros(len(index))
    coupling = np.zeros((len(index), len(index)))
    for name, value in linear.items():
        h[index[name]] = -value
    for (u, v), value in quadratic.items():
        coupling[index[u], index[v]] = coupling[index[v], index[u]] = value
    return Ising(h, coupling, float(offset))
