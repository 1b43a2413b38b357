from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from qiskit.quantum_info import Statevector

from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz, ChainSites
from dispatcher_daemon.solvers.quantum.chain.state import (
    ChainState,
    energies,
    energies_and_gradients,
)
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.ising import Ising
from tests.dispatcher_daemon.solvers.quantum.devices import random_chain, random_one_hot


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
    *(random_chain(n, p, seed) for seed, (n, p) in enumerate(product((1, 2, 6), (1, 2, 3)))),
    random_one_hot((3, 4, 2), 2, 1),
    random_one_hot((5, 4), 1, 2),
    random_one_hot((2, 1, 3, 3), 3, 3),
]


@pytest.mark.parametrize("ansatz", CASES, ids=range(len(CASES)))
def test_state_is_qiskits(ansatz: Ansatz) -> None:
    """Probabilities, means and the energy of a dense model all agree."""
    n = ansatz.width
    state, bits, expected = ChainState(ansatz), all_bits(n), by_qiskit(ansatz)
    z = 1.0 - 2.0 * bits
    assert state.probabilities(bits) == pytest.approx(expected, abs=1e-12)
    assert state.means() == pytest.approx(expected @ z)
    pairs = np.einsum("s,si,sj->ij", expected, z, z)
    ising = random_ising(4, n)
    energy = ising.offset + ising.h @ (expected @ z) + (ising.coupling * pairs).sum() / 2
    assert state.energy(ising) == pytest.approx(energy)


def test_qubits_that_are_not_looked_at_are_summed_over() -> None:
    """The probability of a part of the bits is the sum over the others."""
    ansatz = random_chain(6, 2, 3)
    state, bits = ChainState(ansatz), all_bits(6)
    expected = by_qiskit(ansatz)
    wanted = np.array([[1, -1, 0, -1, -1, 1]], dtype=np.int8)
    fits = (bits[:, 0] == 1) & (bits[:, 2] == 0) & (bits[:, 5] == 1)
    assert state.probabilities(wanted) == pytest.approx([expected[fits].sum()])


@pytest.mark.slow
@pytest.mark.parametrize(
    "ansatz", [random_chain(5, 2, 7), random_one_hot((3, 3), 2, 7)], ids=["chain", "one-hot"]
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


@pytest.mark.slow
@settings(max_examples=3)
@given(seed=st.integers(0, 10_000))
def test_gradient_is_that_of_central_differences(seed: int) -> None:
    """For both kinds of ansätze, two circuits at once, every angle."""
    for one, two in (
        (random_chain(5, 2, seed), random_chain(5, 2, seed + 1)),
        (random_one_hot((3, 2, 3), 2, seed), random_one_hot((3, 2, 3), 2, seed)),
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


@pytest.mark.slow
def test_five_hundred_qubits_are_no_matter() -> None:
    """Energy, gradient and samples of a long chain; nothing grows with 2^n."""
    n = 500
    ansatz = random_chain(n, 1, 1)
    coupling = np.zeros((n, n))
    for i, j in ((0, 1), (3, 499), (250, 260), (100, 400)):
        coupling[i, j] = coupling[j, i] = 1.0 + i / n
    state, ising = ChainState(ansatz), Ising(np.linspace(-1, 1, n), coupling, 0.0)
    values, _ = energies_and_gradients(state.sites, state.sites.flat(ansatz)[None], ising)
    assert values == pytest.approx([state.energy(ising)])
    z = 1.0 - 2.0 * state.sample(2_000, 1)
    drawn = z @ ising.h + ((z @ coupling) * z).sum(axis=1) / 2
    assert values[0] == pytest.approx(drawn.mean(), abs=5 * drawn.std() / 2_000**0.5)
