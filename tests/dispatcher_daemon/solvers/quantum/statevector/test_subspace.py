from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt
import pytest

from dispatcher_daemon.solvers.quantum.ising import Ising
from dispatcher_daemon.solvers.quantum.statevector.diagonal import (
    one_hot_bits,
    one_hot_diagonal,
    standardised,
)
from dispatcher_daemon.solvers.quantum.statevector.subspace import OneHotState, mixer_pairs

GROUPS = ((3, 0), (1, 4, 5), (6, 7, 8, 2))
SCHEDULE = [(0.4, 0.3), (-0.2, 0.7)]


def random_ising(n: int) -> Ising:
    """Normal fields and couplings between all pairs."""
    rng = np.random.default_rng(n)
    upper = np.triu(rng.normal(size=(n, n)), 1)
    return Ising(rng.normal(size=n), upper + upper.T, float(rng.normal()))


def numbers() -> npt.NDArray[np.int64]:
    """Each one-hot state's number among all 2^9, in the subspace's order."""
    bits = one_hot_bits(np.arange(24), GROUPS, 9).astype(np.int64)
    return np.asarray(bits @ (1 << np.arange(9)))


def test_states_are_all_choices_of_one_from_each_group() -> None:
    """Each combination once, the first group counting fastest."""
    bits = one_hot_bits(np.arange(24), GROUPS, 9)
    assert np.flatnonzero(bits[1]).tolist() == [0, 1, 6]
    found = {tuple(np.flatnonzero(row).tolist()) for row in bits}
    assert found == {tuple(sorted(choice)) for choice in product(*GROUPS)}


def test_diagonal_has_the_energy_of_every_state() -> None:
    """C straight from its definition."""
    ising = random_ising(9)
    z = 1 - 2 * one_hot_bits(np.arange(24), GROUPS, 9).astype(float)
    expected = ising.offset + z @ ising.h + ((z @ ising.coupling) * z).sum(axis=1) / 2
    assert one_hot_diagonal(ising, GROUPS) == pytest.approx(expected, abs=1e-5)


def test_standardised_energies_have_mean_0_and_spread_1() -> None:
    """Whatever offset and unit they had; equal ones become 0."""
    diagonal = one_hot_diagonal(random_ising(9), GROUPS)
    found = standardised(1000 + 0.1 * diagonal)
    assert (found.mean(), found.std()) == pytest.approx((0, 1), abs=1e-3)
    assert found == pytest.approx(standardised(diagonal), abs=1e-2)
    assert not standardised(np.full(5, 7.3, dtype=np.float32)).any()


def test_diagonal_refuses_too_many_states() -> None:
    """More than 2^20 combinations are refused, not tried."""
    groups = [tuple(range(5 * g, 5 * g + 5)) for g in range(9)]
    with pytest.raises(ValueError, match="1953125 one-hot states"):
        one_hot_diagonal(Ising(np.zeros(45), np.zeros((45, 45)), 0.0), groups)


def test_state_is_that_of_the_whole_circuit() -> None:
    """Qiskit's 2^9 amplitudes with XXPlusYY gates are these on one-hot states, and 0 elsewhere."""
    from qiskit import QuantumCircuit
    from qiskit.circuit.library import XXPlusYYGate
    from qiskit.quantum_info import Statevector

    ising = random_ising(9)
    state = OneHotState(one_hot_diagonal(ising, GROUPS), GROUPS)
    first = np.zeros(512, dtype=complex)
    first[numbers()] = 24**-0.5
    circuit = QuantumCircuit(9)
    for beta, gamma in SCHEDULE:
        circuit.global_phase -= gamma * ising.offset
        for i in range(9):
            circuit.rz(2 * gamma * ising.h[i], i)
            for j in range(i):
                circuit.rzz(2 * gamma * ising.coupling[i, j], i, j)
        for group in GROUPS:
            for a, b in mixer_pairs(len(group)):
                circuit.append(XXPlusYYGate(-2 * beta), [group[a], group[b]])
    expected = Statevector(first).evolve(circuit).data
    state.evolve(SCHEDULE)
    assert state.amplitudes() == pytest.approx(expected[numbers()], abs=2e-6)
    assert np.abs(expected[numbers()] ** 2).sum() == pytest.approx(1)


def test_samples_have_one_of_each_group() -> None:
    """All samples are valid choices, and are repeated with the seed."""
    state = OneHotState(one_hot_diagonal(random_ising(9), GROUPS), GROUPS)
    state.evolve(SCHEDULE)
    states, counts = state.sample(5000, seed=2)
    bits = state.bits(states)
    assert counts.sum() == 5000
    assert all((bits[:, list(group)].sum(axis=1) == 1).all() for group in GROUPS)
    assert counts / 5000 == pytest.approx(state.probability_of(states), abs=0.03)
    assert np.array_equal(state.sample(5000, seed=2)[1], counts)


def test_groups_of_one_stay() -> None:
    """A vehicle with a single option needs no mixer."""
    groups = ((0,), (1, 2))
    state = OneHotState(one_hot_diagonal(random_ising(3), groups), groups)
    state.evolve([(np.pi / 2, 0.0)])
    assert state.probability_of(np.array([0, 1])) == pytest.approx([0.5, 0.5], abs=1e-6)


def test_groups_must_fit_the_diagonal() -> None:
    """Another number of states is refused."""
    with pytest.raises(ValueError, match="different sizes"):
        OneHotState(np.zeros(5, dtype=np.float32), GROUPS)
