"""Exact matrix product states of chain ansätze: expectations, gradients, samples, probabilities.

Nothing here has 2^n of anything: a sweep costs O(n² 4^p) for the couplings of all pairs of qubits,
and less for the rest. What a sweep carries over a cut are matrices X[r, r'] over the bond's states
of the ket and of the bra. All arrays have a leading axis for circuits of the same shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz, ChainSites, Complex, Index, Real
from dispatcher_daemon.solvers.quantum.ising import Ising

Bits = npt.NDArray[np.int8]


def energies(sites: ChainSites, angles: Real, ising: Ising) -> Real:
    """⟨C⟩ with all fields and couplings, whatever the circuits hold of them, shape (batch,).

    Args:
        angles: of the circuits, shape (batch, angles).
        ising: in chain order.
    """
    return _sweep(sites, sites.tensors(angles), ising, keep=False)[0]


def energies_and_gradients(sites: ChainSites, angles: Real, ising: Ising) -> tuple[Real, Real]:
    """`energies`, and their derivatives by each angle, shapes (batch,) and (batch, angles).

    The forward sweep carries, over each cut, C (the energy so far), L (the norm), and L_i (Z_i
    inserted) for the qubits i behind it that are coupled to qubits ahead. The reverse
    sweep carries what each of them will be multiplied by, in the same order.
    """
    tensors = sites.tensors(angles)
    values, stacks = _sweep(sites, tensors, ising, keep=True)
    batch, bond = angles.shape[0], 1 << sites.layers
    duals = np.zeros((batch, 2, bond, bond), dtype=complex)
    duals[:, 0] = 1.0
    by_tensor: list[Complex] = []
    for tensor, spins, cut, stack in zip(
        reversed(tensors),
        reversed(sites.spins),
        reversed(_cuts(sites, ising)),
        reversed(stacks),
        strict=True,
    ):
        states = spins.shape[1]
        # b, a', x by row: the dual's bra side contracted with the conjugate tensor.
        bra = tensor.conj().transpose(0, 3, 1, 2).reshape(batch, bond, -1)
        half = duals.reshape(batch, -1, bond) @ bra
        half = half.reshape(batch, -1, bond, bond, states)
        norm, ends = half[:, 0], 2 + len(cut.kept)
        main = np.zeros((batch, 2 + len(cut.behind), *half.shape[2:]), dtype=complex)
        main[:, :2] = half[:, :2]
        main[:, 2 + cut.kept] = half[:, 2:ends]
        main[:, 1] += _site_energies(ising, cut.first, spins) * norm
        main[:, 1] += np.einsum("mx,rmbax->rbax", spins[cut.new], half[:, ends:])
        ahead = ising.coupling[cut.behind, cut.first : cut.first + len(spins)] @ spins
        main[:, 2:] += ahead[None, :, None, None, :] * norm[:, None]
        turned = main.transpose(0, 1, 3, 4, 2).reshape(batch, -1, states * bond)
        gamma = stack.transpose(0, 2, 1, 3).reshape(batch, bond, -1) @ turned
        by_tensor.append(gamma.reshape(tensor.shape))
        duals = turned @ tensor.reshape(batch, bond, -1).swapaxes(-1, -2)
        duals = duals.reshape(batch, -1, bond, bond).swapaxes(-1, -2)
    by_tensor.reverse()
    return values, sites.gradient(angles, by_tensor)


def _sweep(
    sites: ChainSites, tensors: Sequence[Complex], ising: Ising, *, keep: bool
) -> tuple[Real, list[Complex]]:
    """Energies, and before each site the stack C, L, L_i, ... if they are to be kept."""
    batch, bond = len(tensors[0]), 1 << sites.layers
    stack = np.zeros((batch, 2, bond, bond), dtype=complex)
    stack[:, 1, 0, 0] = 1.0
    stacks = []
    for tensor, spins, cut in zip(tensors, sites.spins, _cuts(sites, ising), strict=True):
        if keep:
            stacks.append(stack)
        norm = stack[:, 1:2]
        behind = stack[:, 2:].reshape(batch, -1, bond * bond)
        couplings = ising.coupling[cut.first : cut.first + len(spins), cut.behind]
        open_ends = (couplings @ behind).reshape(batch, -1, bond, bond)
        inserted = np.concatenate([norm, open_ends, np.repeat(norm, len(cut.new), axis=1)], axis=1)
        own = _site_energies(ising, cut.first, spins)[None]
        added = _forward(inserted, tensor, np.concatenate([own, spins, spins[cut.new]]))
        going = np.concatenate([[0, 1], 2 + cut.kept])
        count = 1 + len(spins)
        stack = np.concatenate([_forward(stack[:, going], tensor), added[:, count:]], axis=1)
        stack[:, 0] += added[:, :count].sum(axis=1)
    return ising.offset + stack[:, 0].sum(axis=(-1, -2)).real, stacks


@dataclass(frozen=True)
class _Cut:
    """Which Z of the qubits before a site it takes over, and which it hands on.

    Attributes:
        first: first qubit of the site.
        behind: qubits before it with a coupling to it or beyond it.
        kept: positions in ``behind`` of those with a coupling beyond it.
        new: its own qubits, counted from ``first``, with a coupling beyond it.
    """

    first: int
    behind: Index
    kept: Index
    new: Index


def _cuts(sites: ChainSites, ising: Ising) -> list[_Cut]:
    n = len(ising.h)
    # The farthest qubit that each one is coupled to; −1 without any.
    last = np.where(ising.coupling != 0, np.arange(n), -1).max(axis=1)
    behind, first, found = np.zeros(0, dtype=np.int64), 0, []
    for spins in sites.spins:
        end = first + len(spins)
        kept = np.flatnonzero(last[behind] >= end)
        new = np.flatnonzero(last[first:end] >= end)
        found.append(_Cut(first, behind, kept, new))
        behind, first = np.concatenate([behind[kept], first + new]), end
    return found


def _site_energies(ising: Ising, first: int, spins: Real) -> Real:
    """Energy within a site by its state, shape (d,)."""
    own = slice(first, first + len(spins))
    pairs = np.einsum("ix,ij,jx->x", spins, np.triu(ising.coupling[own, own], 1), spins)
    return np.asarray(ising.h[own] @ spins + pairs)


def _forward(matrices: Complex, tensor: Complex, weights: Real | None = None) -> Complex:
    """Σ_x w(x) A_xᵀ X conj(A_x) of each matrix, shape (batch, matrices, D, D)."""
    batch, bond, states, _ = tensor.shape
    half = matrices.reshape(batch, -1, bond) @ tensor.conj().reshape(batch, bond, -1)
    half = half.reshape(batch, -1, bond, states, bond)
    if weights is not None:
        half = half * weights[None, :, None, :, None]
    half = half.reshape(batch, -1, bond * states, bond).swapaxes(-1, -2)
    whole = half.reshape(batch, -1, bond * states) @ tensor.reshape(batch, -1, bond)
    return whole.reshape(batch, -1, bond, bond).swapaxes(-1, -2)


@dataclass(frozen=True, eq=False)
class ChainState:
    """The state that one ansatz prepares.

    Attributes:
        prepared: the ansatz.
    """

    prepared: Ansatz

    @cached_property
    def sites(self) -> ChainSites:
        """Its sites."""
        return ChainSites(self.prepared)

    @cached_property
    def _tensors(self) -> list[Complex]:
        return [t[0] for t in self.sites.tensors(self.sites.flat(self.prepared)[None])]

    @cached_property
    def _right(self) -> list[Complex]:
        """Everything right of each cut, traced out; one matrix more than sites."""
        bond = 1 << self.prepared.layers
        found = [np.ones((bond, bond), dtype=complex)]
        for tensor in reversed(self._tensors):
            half = np.tensordot(tensor, found[-1], axes=1)
            found.append(np.tensordot(half, tensor.conj(), axes=([1, 2], [1, 2])))
        found.reverse()
        return found

    def energy(self, ising: Ising) -> float:
        """⟨C⟩ with all fields and couplings of C; ``ising`` in chain order."""
        return float(energies(self.sites, self.sites.flat(self.prepared)[None], ising)[0])

    def means(self) -> Real:
        """⟨Z_i⟩, shape (n,)."""
        return np.concatenate([spins @ self._shares(q) for q, spins in enumerate(self.sites.spins)])

    def _shares(self, site: int) -> Real:
        """P(x) of one site's states, shape (d,)."""
        left, tensor = self._unassigned[site], self._tensors[site]
        half = np.tensordot(left, tensor.conj(), axes=([1], [0]))  # a, x, b'
        whole = np.einsum("axc,axb->xbc", half, tensor)
        return np.asarray(np.einsum("xbc,bc->x", whole, self._right[site + 1]).real)

    @cached_property
    def _unassigned(self) -> list[Complex]:
        bond = 1 << self.prepared.layers
        here = np.zeros((1, 1, bond, bond), dtype=complex)
        here[..., 0, 0] = 1.0
        found = []
        for tensor in self._tensors:
            found.append(here[0, 0])
            here = _forward(here, tensor[None])
        return found

    def sample(self, shots: int, seed: int) -> Bits:
        """Independent exact samples by qubit of the chain, shape (shots, n)."""
        rng = np.random.default_rng(seed)
        bond = 1 << self.prepared.layers
        ket = np.zeros((shots, bond), dtype=complex)
        ket[:, 0] = 1.0
        drawn = []
        for site, (tensor, spins) in enumerate(zip(self._tensors, self.sites.spins, strict=True)):
            states = spins.shape[1]
            ahead = (ket @ tensor.reshape(bond, -1)).reshape(shots, states, bond)
            traced = ahead.reshape(-1, bond) @ self._right[site + 1]
            weights = (traced.reshape(ahead.shape) * ahead.conj()).sum(axis=-1).real
            edges = np.cumsum(np.maximum(weights, 0.0), axis=1)
            point = rng.random(shots) * edges[:, -1]
            choice = np.minimum((edges <= point[:, None]).sum(axis=1), states - 1)
            weight = np.take_along_axis(weights, choice[:, None], axis=1)
            ket = ahead[np.arange(shots), choice] / np.sqrt(weight)
            drawn.append((spins[:, choice] < 0).T.astype(np.int8))
        return np.concatenate(drawn, axis=1)

    def probabilities(self, bits: Bits) -> Real:
        """Probability of each pattern, shape (patterns, n) → (patterns,).

        A qubit whose bit is −1 is not looked at; in a group all are, or none.
        """
        bond = 1 << self.prepared.layers
        here = np.zeros((len(bits), bond, bond), dtype=complex)
        here[:, 0, 0] = 1.0
        first = 0
        for tensor, spins in zip(self._tensors, self.sites.spins, strict=True):
            own = bits[:, first : first + len(spins)]
            states = (1 - spins.T) / 2
            fits = ((own[:, None, :] == states) | (own[:, None, :] < 0)).all(axis=2)
            half = (here.reshape(-1, bond) @ tensor.conj().reshape(bond, -1)).reshape(
                len(bits), bond, -1, bond
            ) * fits[:, None, :, None]
            half = half.reshape(len(bits), -1, bond).swapaxes(-1, -2).reshape(len(bits) * bond, -1)
            here = (half @ tensor.reshape(-1, bond)).reshape(-1, bond, bond).swapaxes(-1, -2)
            first += len(spins)
        return np.asarray(np.maximum(here.sum(axis=(-1, -2)).real, 0.0))
