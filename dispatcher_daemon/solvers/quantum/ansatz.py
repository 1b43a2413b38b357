"""Circuits on a chain as tables of gate angles, for training, simulation and construction.

Angles are those of Qiskit's gates, in radians: RZ(φ) = e^{−iφZ/2}, RZZ(θ) = e^{−iθZZ/2},
RX(α) = e^{−iαX/2}, XXPlusYY(β) = e^{−iβ(XX+YY)/4}. Qubit q is the q-th of the chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.ising import Ising

Angles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ChainAnsatz:
    """Layers of fields, neighbours' couplings and a transverse mixer, from |+⟩ on every qubit.

    Each layer is RZ on every qubit, RZZ on the even and then the odd pairs of neighbours, RX on
    every qubit. An angle of 0 is no gate, so that a chain may have gaps.

    Attributes:
        fields: RZ angles, shape (layers, n).
        bonds: RZZ angles of the pairs (q, q + 1), shape (layers, n − 1).
        mixers: RX angles, shape (layers, n).
    """

    fields: Angles
    bonds: Angles
    mixers: Angles

    def __post_init__(self) -> None:
        layers, n = self.fields.shape
        if self.bonds.shape != (layers, n - 1) or self.mixers.shape != (layers, n):
            raise ValueError("tables of angles of different sizes")

    @property
    def layers(self) -> int:
        """Depth p."""
        return int(self.fields.shape[0])

    @property
    def width(self) -> int:
        """Number of qubits n."""
        return int(self.fields.shape[1])


@dataclass(frozen=True)
class OneHotAnsatz:
    """Layers that keep one qubit of each group in |1⟩; groups are contiguous on the chain.

    Each group starts with its ``hot`` qubit in |1⟩, spread outwards from there by XXPlusYY gates
    between neighbours: pairs by growing distance, at equal distance the upper one first. Each
    layer is RZ on every qubit, RZZ between the last qubit of a group and the first of the next,
    and XXPlusYY on the even and then the odd pairs inside groups.

    Attributes:
        groups: sizes, in chain order.
        hot: first excited qubit of each group, counted along the chain.
        spread: XXPlusYY angles of the start by pair (q, q + 1), shape (n − 1,); 0 between groups.
        fields: RZ angles, shape (layers, n).
        bonds: RZZ angles between neighbouring groups, shape (layers, groups − 1).
        mixers: XXPlusYY angles by pair, shape (layers, n − 1); 0 between groups.
    """

    groups: tuple[int, ...]
    hot: tuple[int, ...]
    spread: Angles
    fields: Angles
    bonds: Angles
    mixers: Angles

    def __post_init__(self) -> None:
        n, layers = sum(self.groups), self.fields.shape[0]
        shapes = (self.spread.shape, self.fields.shape, self.bonds.shape, self.mixers.shape)
        if shapes != ((n - 1,), (layers, n), (layers, len(self.groups) - 1), (layers, n - 1)):
            raise ValueError("tables of angles of different sizes")

    @property
    def layers(self) -> int:
        """Depth p."""
        return int(self.fields.shape[0])

    @property
    def width(self) -> int:
        """Number of qubits n."""
        return int(self.fields.shape[1])


def spread_pairs(size: int, hot: int) -> list[int]:
    """Pairs (i, i + 1) of a group, by i, as its start mixes them: see `OneHotAnsatz`."""
    pairs = []
    for distance in range(size - 1):
        if hot + distance + 1 < size:
            pairs.append(hot + distance)
        if hot - distance - 1 >= 0:
            pairs.append(hot - distance - 1)
    return pairs


def linear_ramp(layers: int, delta_beta: float, delta_gamma: float) -> list[tuple[float, float]]:
    """(β_i, γ_i) with β_i = (1 − i/p) Δβ and γ_i = ((i + 1)/p) Δγ, i = 0..p − 1 (LR-QAOA)."""
    return [
        ((1 - i / layers) * delta_beta, ((i + 1) / layers) * delta_gamma) for i in range(layers)
    ]


def scheduled(
    ising: Ising, schedule: Sequence[tuple[float, float]], cuts: Sequence[int] = ()
) -> ChainAnsatz:
    """e^{−iγ C_chain} and e^{+iβ ΣX} in turn: QAOA with the couplings of neighbours only.

    That sign of β goes with the ramp: |+⟩^n is the ground state of −ΣX, and C is to be minimised.

    Args:
        ising: in chain order, normalised.
        schedule: (β, γ) of each layer.
        cuts: bonds (q, q + 1), by q, that get no gate.
    """
    beta, gamma = np.array(schedule, dtype=float).reshape(-1, 2).T
    bonds = 2 * gamma[:, None] * np.diagonal(ising.coupling, 1)
    bonds[:, list(cuts)] = 0.0
    return ChainAnsatz(
        fields=2 * gamma[:, None] * ising.h,
        bonds=bonds,
        mixers=np.repeat(-2 * beta[:, None], len(ising.h), axis=1),
    )
