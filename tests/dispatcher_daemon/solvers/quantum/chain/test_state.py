from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from qiskit.quantum_info import Statevector

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, OneHotAnsatz
from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz, ChainSites
from dispatcher_daemon.solvers.quantum.chain.state import (
    ChainState,
    energies,
    energies_and_gradients,
)
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.ising import Ising


def random_chain(seed: int, n: int, layers: int) -> ChainAnsatz:
    """Angles of any size, with a gap."""
    rng = np.random.default_rng(seed)
    bonds = rng.uniform(-3, 3, (layers, n - 1))
    bonds[0, : n // 3] = 0.0
    return ChainAnsatz(rng.uniform(-3, 3, (layers, n)), bonds, rng.uniform(-3, 3, (layers, n)))


def random_one_hot(seed: int, groups: tuple[int, ...], layers: int) -> OneHotAnsatz:
    """Angles of any size; hot qubits at random places."""
    rng = np.random.default_rng(seed)
    n = sum(groups)
    starts = np.cumsum([0, *groups])
    inside = np.ones(n - 1)
    inside[starts[1:-1] - 1] = 0.0
    return OneHotAnsatz(
        groups=groups,
        hot=tuple(int(s + rng.integers(g)) for s, g in zip(starts, groups, strict=False)),
        spread=rng.uniform(-3, 3, n - 1) * inside,
        fields=rng.uniform(-3, 3, (layers, n)),
        bonds=rng.uniform(-3, 3, (layers, len(groups) - 1)),
        mixers=rng.uniform(-3, 3, (layers, n - 1)) * inside,
    )


def random_ising(seed: int, n: int) -> Ising:
    """Couplings all over, not only the chain's; about half of them are 0."""
    rng = np.random.default_rng(seed)
    coupling = np.triu(rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.5), 1)
    return Ising(rng.normal(size=n), coupling + coupling.T, float(rng.normal()))


def by_qiskit(ansatz: Ansatz) -> np.ndarray:
    """Probability of each state; bit q of its number is on qubit q."""
    circuit = circuit_of(ansatz).remove_final_measurements(inplace=False)
    return np.asarray(Statevector(circuit).probabilities())


def all_bits(n: int) -> np.ndarray:
    """Every state, in the order of their numbers."""
    return ((np.arange(1 << n)[:, None] >> np.arange(n)) & 1).astype(np.int8)


CASES = [
    *(random_chain(seed, n, p) for seed, (n, p) in enumerate(product((1, 2, 6), (1, 2, 3)))),
    random_one_hot(1, (3, 4, 2), 2),
    random_one_hot(2, (5, 4), 1),
    random_one_hot(3, (2, 1, 3, 3), 3),
]


@pytest.mark.parametrize("ansatz", CASES, ids=range(len(CASES)))
def test_state_is_qiskits(ansatz: Ansatz) -> None:
    """Norm, probabilities, means, correlations and the energy of a dense model all agree."""
    n = ansatz.width
    state, bits, expected = ChainState(ansatz), all_bits(n), by_qiskit(ansatz)
    z = 1.0 - 2.0 * bits
    assert state.norm() == pytest.approx(1.0)
    assert state.probabilities(bits) == pytest.approx(expected, abs=1e-12)
    assert state.means() == pytest.approx(expected @ z)
    pairs = np.einsum("s,si,sj->ij", expected, z, z)
    assert state.correlations() == pytest.approx(pairs, abs=1e-12)
    ising = random_ising(4, n)
    energy = ising.offset + ising.h @ (expected @ z) + (ising.coupling * pairs).sum() / 2
    assert state.energy(ising) == pytest.approx(energy)


def test_qubits_that_are_not_looked_at_are_summed_over() -> None:
    """The probability of a part of the bits is the sum over the others."""
    ansatz = random_chain(3, 6, 2)
    state, bits = ChainState(ansatz), all_bits(6)
    expected = by_qiskit(ansatz)
    wanted = np.array([[1, -1, 0, -1, -1, 1]], dtype=np.int8)
    fits = (bits[:, 0] == 1) & (bits[:, 2] == 0) & (bits[:, 5] == 1)
    assert state.probabilities(wanted) == pytest.approx([expected[fits].sum()])


@pytest.mark.parametrize(
    "ansatz", [random_chain(7, 5, 2), random_one_hot(7, (3, 3), 2)], ids=["chain", "one-hot"]
)
def test_samples_follow_the_distribution(ansatz: Ansatz) -> None:
    """Chi-square of 20,000 samples stays below its 99.99 % quantile; one seed, one sample."""
    from scipy.stats import chi2

    state, shots = ChainState(ansatz), 20_000
    drawn = state.sample(shots, seed=5)
    assert np.array_equal(drawn, state.sample(shots, seed=5))
    assert not np.array_equal(drawn, state.sample(shots, seed=6))
    counts = np.bincount(drawn.astype(int) @ (1 << np.arange(ansatz.width)), minlength=1)
    expected = by_qiskit(ansatz) * shots
    counts = np.pad(counts, (0, len(expected) - len(counts)))
    assert counts[expected < 1e-9].sum() == 0
    common = expected > 5
    statistic = ((counts - expected)[common] ** 2 / expected[common]).sum()
    assert statistic < chi2.ppf(0.9999, common.sum() - 1)


@settings(max_examples=3)
@given(seed=st.integers(0, 10_000))
def test_gradient_is_that_of_central_differences(seed: int) -> None:
    """For both kinds of ansätze, two circuits at once, every angle."""
    for one, two in (
        (random_chain(seed, 5, 2), random_chain(seed + 1, 5, 2)),
        (random_one_hot(seed, (3, 2, 3), 2), random_one_hot(seed, (3, 2, 3), 2)),
    ):
        sites = ChainSites(one)
        angles = np.array([sites.flat(one), sites.flat(two)])
        ising = random_ising(seed, one.width)
        values, gradients = energies_and_gradients(sites, angles, ising)
        assert values == pytest.approx(energies(sites, angles, ising))
        assert gradients[:, ~sites.free()] == pytest.approx(0.0)
        for i in np.flatnonzero(sites.free()):
            step = np.zeros(angles.shape[1])
            step[i] = 1e-5
            rise = energies(sites, angles + step, ising) - energies(sites, angles - step, ising)
            assert gradients[:, i] == pytest.approx(rise / 2e-5, abs=1e-6)


def test_angles_go_to_a_vector_and_back() -> None:
    """No angle is lost or moved, and gaps between groups stay closed."""
    for ansatz in CASES:
        sites = ChainSites(ansatz)
        again = sites.ansatz(sites.flat(ansatz))
        assert type(again) is type(ansatz)
        assert np.array_equal(sites.flat(again), sites.flat(ansatz))


def test_five_hundred_qubits_are_no_matter() -> None:
    """Norm, energy, gradient and samples of a long chain; nothing grows with 2^n."""
    n = 500
    ansatz = random_chain(1, n, 1)
    coupling = np.zeros((n, n))
    for i, j in ((0, 1), (3, 499), (250, 260), (100, 400)):
        coupling[i, j] = coupling[j, i] = 1.0 + i / n
    state, ising = ChainState(ansatz), Ising(np.linspace(-1, 1, n), coupling, 0.0)
    assert state.norm() == pytest.approx(1.0)
    values, _ = energies_and_gradients(state.sites, state.sites.flat(ansatz)[None], ising)
    pairs = state.correlations()
    assert values == pytest.approx([ising.h @ state.means() + (coupling * pairs).sum() / 2])
    assert state.sample(20, 1).shape == (20, n)
