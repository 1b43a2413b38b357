"""From the angles of chain ansätze to the tensors of their matrix product states, and back.

A site is one qubit, or one group of a one-hot ansatz. All gates between sites are RZZ, diagonal and
of rank 2, so the bond state is the p bits that a site's last qubit had in the p
layers: D = 2^p. With T the site's own gates summed over all paths through them that end in x and
have the bits l of its first and r of its last qubit, the tensor is A[l', x, r] = Σ_l W[l', l]
T[l, x, r], where W[l', l] = exp(−½ i Σ_k θ_k z_k(l') z_k(l)) are the RZZ gates to the site before.
That is exact: nothing is truncated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, OneHotAnsatz, spread_pairs

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Index = npt.NDArray[np.int64]

Ansatz = ChainAnsatz | OneHotAnsatz


@dataclass(frozen=True, eq=False)
class SiteKind:
    """Sites that are alike but for their angles.

    The d states of a site are those of its qubit, or the places of its group's 1.

    Attributes:
        sites: their numbers along the chain, s of them.
        angles: where each one's angles are in the flat vector, shape (s, angles of a site): first
            those of the start, then of each layer the fields and the mixers.
        spins: z of each of its m qubits in each of its d states, shape (m, d).
        start: amplitudes before all gates, shape (d,).
        spread: pairs of states (i, i + 1), by i, that the start's gates mix.
        mix: the same of a layer's mixers.
        layers: p.
    """

    sites: Index
    angles: Index
    spins: Real
    start: Real
    spread: tuple[int, ...]
    mix: tuple[int, ...]
    layers: int

    def own(self, angles: Real) -> Complex:
        """T of given angles, shape (..., angles) → (..., D, d, D)."""
        qubits, states = self.spins.shape
        left, right = (np.array([z > 0, z < 0], dtype=float) for z in self.spins[[0, -1]])
        recorded = left[:, None, None, :] * right[None, None, :, :]  # l, 1, r, x
        shape = angles.shape[:-1]
        ways = np.broadcast_to(self.start.astype(complex), (*shape, 1, 1, states)).copy()
        used = len(self.spread)
        for i, angle in zip(self.spread, np.moveaxis(angles[..., :used], -1, 0), strict=True):
            _rotate(ways, i, angle)
        for layer in range(self.layers):
            fields = angles[..., used : used + qubits]
            used += qubits
            ways = ways * np.exp(-0.5j * (fields @ self.spins))[..., None, None, :]
            size = 2 << layer
            ways = (ways[..., :, None, :, None, :] * recorded).reshape(*shape, size, size, states)
            for i in self.mix:
                _rotate(ways, i, angles[..., used])
                used += 1
        return np.moveaxis(ways, -1, -2)

    def own_derivatives(self, angles: Real) -> Complex:
        """dT by each angle, shape (..., angles) → (..., angles, D, d, D).

        All gates are e^{−iθG/2} with G² = 1 where G acts and 0 elsewhere, so that the derivative is
        (T(θ + π) − T(θ − π))/4 exactly.
        """
        shift = np.pi * np.eye(angles.shape[-1])
        around = angles[..., None, :]
        difference: Complex = (self.own(around + shift) - self.own(around - shift)) / 4
        return difference


def _rotate(ways: Complex, i: int, angle: Real) -> None:
    """Mix states i and i + 1 in place: RX of a qubit, XXPlusYY inside a group."""
    cosine = np.cos(angle / 2)[..., None, None]
    sine = -1j * np.sin(angle / 2)[..., None, None]
    one, two = ways[..., i].copy(), ways[..., i + 1]
    ways[..., i] = cosine * one + sine * two
    ways[..., i + 1] = sine * one + cosine * two


@dataclass(frozen=True, eq=False)
class ChainSites:
    """The sites of one ansatz, whatever its angles.

    Its tables of angles make one flat vector: (spread,) fields, bonds, mixers, row by row.

    Attributes:
        like: an ansatz of that shape.
    """

    like: Ansatz

    @property
    def layers(self) -> int:
        """Depth p."""
        return self.like.layers

    @cached_property
    def kinds(self) -> tuple[SiteKind, ...]:
        """Kinds of sites; each site is of one."""
        if isinstance(self.like, ChainAnsatz):
            return (_qubits(self.like),)
        return _groups(self.like)

    @cached_property
    def bonds(self) -> Index:
        """Where the RZZ angles are in the flat vector, shape (sites − 1, p)."""
        bonds = _places(self.like)["bonds"]
        return np.ascontiguousarray(bonds.T)

    @cached_property
    def spins(self) -> tuple[Real, ...]:
        """By site: z of its qubits in each of its states, shape (m, d)."""
        by_site = {int(q): kind.spins for kind in self.kinds for q in kind.sites}
        return tuple(by_site[q] for q in range(len(by_site)))

    def flat(self, ansatz: Ansatz) -> Real:
        """All angles of an ansatz of this shape as one vector."""
        return np.concatenate([getattr(ansatz, name).ravel() for name in _tables(self.like)])

    def ansatz(self, angles: Real) -> Ansatz:
        """The ansatz that has these angles, shape (angles,)."""
        places = _places(self.like)
        tables = {name: angles[places[name]] for name in _tables(self.like)}
        if isinstance(self.like, ChainAnsatz):
            return ChainAnsatz(**tables)
        return OneHotAnsatz(groups=self.like.groups, hot=self.like.hot, **tables)

    def free(self) -> npt.NDArray[np.bool_]:
        """Which angles of the flat vector belong to a gate."""
        size = sum(places.size for places in _places(self.like).values())
        used = [self.bonds.ravel(), *(kind.angles.ravel() for kind in self.kinds)]
        return np.isin(np.arange(size), np.concatenate(used))

    def tensors(self, angles: Real) -> list[Complex]:
        """A of each site, shape (batch, D, d, D) each, of angles (batch, angles).

        The first site has W = 1 everywhere: contract it with (1, 0, 0, ...) on the left, the last
        with ones on the right.
        """
        weights = self._weights(angles)
        found: dict[int, Complex] = {}
        for kind in self.kinds:
            own = kind.own(angles[:, kind.angles])
            joined = weights[:, kind.sites] @ own.reshape(*own.shape[:3], -1)
            joined = joined.reshape(own.shape)
            found.update(zip(kind.sites.tolist(), np.moveaxis(joined, 1, 0), strict=True))
        return [found[q] for q in range(len(found))]

    def gradient(self, angles: Real, by_tensor: Sequence[Complex]) -> Real:
        """From dE/dA (E real, A and its conjugate apart) to dE by angle, shape (batch, angles)."""
        weights = self._weights(angles)
        spins = _layer_spins(self.layers)
        result = np.zeros_like(angles)
        for kind in self.kinds:
            own = kind.own(angles[:, kind.angles])
            outer = np.stack([by_tensor[q] for q in kind.sites], axis=1)
            outer = outer.reshape(*outer.shape[:3], -1)
            to_own = weights[:, kind.sites].swapaxes(-1, -2) @ outer
            derivatives = kind.own_derivatives(angles[:, kind.angles])
            flat = derivatives.reshape(*derivatives.shape[:3], -1)
            local = flat @ to_own.reshape(*to_own.shape[:2], -1, 1)
            result[:, kind.angles] += 2 * local[..., 0].real
            to_weights = outer @ own.reshape(*own.shape[:3], -1).swapaxes(-1, -2)
            phases = (-0.5j * to_weights * weights[:, kind.sites]).real
            bonds = 2 * np.einsum("bsij,kij->bsk", phases, spins)
            joined = kind.sites > 0
            result[:, self.bonds[kind.sites[joined] - 1]] += bonds[:, joined]
        return result

    def _weights(self, angles: Real) -> Complex:
        """W of all sites, shape (batch, sites, D, D)."""
        theta = angles[:, self.bonds]
        theta = (
            np.concatenate([np.zeros_like(theta[:, :1]), theta], axis=1)
            if theta.size
            else (np.zeros((len(angles), 1, self.layers)))
        )
        phase: Complex = np.exp(-0.5j * np.tensordot(theta, _layer_spins(self.layers), axes=1))
        return phase


def _layer_spins(layers: int) -> Real:
    """z_k(l') z_k(l) by layer k, shape (p, D, D); the first layer is the highest bit."""
    states = np.arange(1 << layers)
    bits = (states >> np.arange(layers - 1, -1, -1)[:, None]) & 1
    z = 1.0 - 2.0 * bits
    return z[:, :, None] * z[:, None, :]


def _tables(ansatz: Ansatz) -> tuple[str, ...]:
    start = () if isinstance(ansatz, ChainAnsatz) else ("spread",)
    return (*start, "fields", "bonds", "mixers")


def _places(ansatz: Ansatz) -> dict[str, Index]:
    """Tables of indices into the flat vector, by name."""
    places, used = {}, 0
    for name in _tables(ansatz):
        table = getattr(ansatz, name)
        places[name] = used + np.arange(table.size).reshape(table.shape)
        used += table.size
    return places


def _qubits(ansatz: ChainAnsatz) -> SiteKind:
    places = _places(ansatz)
    angles = np.stack([places["fields"].T, places["mixers"].T], axis=-1)
    return SiteKind(
        sites=np.arange(ansatz.width),
        angles=angles.reshape(ansatz.width, -1),
        spins=np.array([[1.0, -1.0]]),
        start=np.full(2, np.sqrt(0.5)),
        spread=(),
        mix=(0,),
        layers=ansatz.layers,
    )


def _groups(ansatz: OneHotAnsatz) -> tuple[SiteKind, ...]:
    places = _places(ansatz)
    starts = np.cumsum([0, *ansatz.groups])
    alike: dict[tuple[int, int, int], list[int]] = {}
    for group, (size, hot) in enumerate(zip(ansatz.groups, ansatz.hot, strict=True)):
        first = int(starts[group])
        # Even and odd pairs are counted along the whole chain.
        alike.setdefault((size, hot - first, first % 2), []).append(group)
    kinds = []
    for (size, hot, parity), sites in alike.items():
        spread = tuple(spread_pairs(size, hot))
        mix = (*range(parity, size - 1, 2), *range(1 - parity, size - 1, 2))
        angles = []
        for first in starts[sites].tolist():
            own = [places["spread"][[first + i for i in spread]]]
            for layer in range(ansatz.layers):
                own.append(places["fields"][layer, first : first + size])
                own.append(places["mixers"][layer, [first + i for i in mix]])
            angles.append(np.concatenate([part.astype(np.int64) for part in own]))
        kinds.append(
            SiteKind(
                sites=np.array(sites),
                angles=np.array(angles),
                spins=1.0 - 2.0 * np.eye(size),
                start=np.eye(size)[hot],
                spread=spread,
                mix=mix,
                layers=ansatz.layers,
            )
        )
    return tuple(kinds)
