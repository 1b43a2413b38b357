from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.solvers.quantum.ising import Ising
from dispatcher_daemon.solvers.quantum.statevector import transverse
from dispatcher_daemon.solvers.quantum.statevector.diagonal import cost_diagonal
from dispatcher_daemon.solvers.quantum.statevector.exact_state import Schedule
from dispatcher_daemon.solvers.quantum.statevector.transverse import StateVector, memory_bytes

SCHEDULE = [(0.4, 0.3), (-0.2, 0.7)]


def random_ising(n: int, seed: int = 1) -> Ising:
    """Normal fields and couplings between all pairs."""
    rng = np.random.default_rng(seed)
    upper = np.triu(rng.normal(size=(n, n)), 1)
    return Ising(rng.normal(size=n), upper + upper.T, float(rng.normal()))


def energies(ising: Ising) -> npt.NDArray[np.float64]:
    """C of all states, straight from its definition."""
    n = len(ising.h)
    z = 1 - 2 * ((np.arange(1 << n)[:, None] >> np.arange(n)) & 1)
    return np.asarray(ising.offset + z @ ising.h + ((z @ ising.coupling) * z).sum(axis=1) / 2)


def qiskit_amplitudes(ising: Ising, schedule: Schedule) -> npt.NDArray[np.complex128]:
    """The same circuit, gate by gate."""
    from qiskit import QuantumCircuit
    from qiskit.quantum_info import Statevector

    n = len(ising.h)
    circuit = QuantumCircuit(n, global_phase=0)
    circuit.h(range(n))
    for beta, gamma in schedule:
        circuit.global_phase -= gamma * ising.offset
        for i in range(n):
            circuit.rz(2 * gamma * ising.h[i], i)
            for j in range(i):
                circuit.rzz(2 * gamma * ising.coupling[i, j], i, j)
        circuit.rx(-2 * beta, range(n))
    return np.asarray(Statevector(circuit).data)


@given(n=st.integers(1, 7), seed=st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_diagonal_has_the_energy_of_every_state(n: int, seed: int) -> None:
    """Entry s is C of the bits of s, the least significant one on qubit 0."""
    ising = random_ising(n, seed)
    assert cost_diagonal(ising) == pytest.approx(energies(ising), abs=1e-5)


def test_diagonal_refuses_what_no_memory_holds() -> None:
    """28 qubits are refused, not tried."""
    with pytest.raises(ValueError, match="28 qubits"):
        cost_diagonal(Ising(np.zeros(28), np.zeros((28, 28)), 0.0))


@pytest.mark.parametrize("n", [1, 2, 4, 6, 9])
def test_amplitudes_are_qiskits(n: int) -> None:
    """Signs, phases and bit order agree with Qiskit's simulation of the gates."""
    ising = random_ising(n, seed=n)
    state = StateVector(cost_diagonal(ising))
    state.evolve(SCHEDULE)
    assert state.amplitudes() == pytest.approx(qiskit_amplitudes(ising, SCHEDULE), abs=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "low_bits"), [(16, 15), (5, 4), (9, 4), (13, 2)])
def test_states_of_many_blocks_are_mixed_right(
    n: int, low_bits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However blocks and groups fall: the mixer by axes in double precision gives the same."""
    monkeypatch.setattr(transverse, "_LOW_BITS", low_bits)
    ising = random_ising(n).normalised()
    found = StateVector(cost_diagonal(ising))
    found.evolve(SCHEDULE)
    cost = energies(ising)
    state = np.full(1 << n, 2 ** (-n / 2), dtype=complex)
    for beta, gamma in SCHEDULE:
        state = (np.exp(-1j * gamma * cost) * state).reshape([2] * n)
        mixer = np.array([[np.cos(beta), 1j * np.sin(beta)], [1j * np.sin(beta), np.cos(beta)]])
        for axis in range(n):
            state = np.moveaxis(np.tensordot(mixer, state, (1, axis)), 0, axis)
        state = state.ravel()
    assert found.amplitudes() == pytest.approx(state, abs=1e-6)
    assert found.mean() == pytest.approx(float(np.abs(state) ** 2 @ cost), rel=1e-5)


@pytest.mark.slow
def test_norm_is_kept_in_single_precision() -> None:
    """20 qubits, ten layers: the norm is 1 within 1e-5, where 1e-4 is asked for."""
    state = StateVector(cost_diagonal(random_ising(20).normalised()))
    state.evolve([(0.3, 0.5)] * 10)
    assert state.norm() == pytest.approx(1, abs=1e-5)


def test_samples_follow_the_probabilities() -> None:
    """Frequencies of 400,000 shots, over several blocks, are the probabilities; a seed repeats."""
    state = StateVector(cost_diagonal(random_ising(17).normalised()))
    state.evolve([(0.7, 1.2)])
    states, counts = state.sample(400_000, seed=5)
    assert counts.sum() == 400_000
    ones = (counts @ state.bits(states)) / 400_000
    p = np.abs(state.amplitudes()) ** 2
    every = state.bits(np.arange(1 << 17))
    assert ones == pytest.approx(p @ every, abs=0.005)
    again = state.sample(400_000, seed=5)
    assert np.array_equal(again[0], states)
    assert np.array_equal(again[1], counts)
    assert not np.array_equal(state.sample(400_000, seed=6)[0], states)


def test_probability_of_given_states() -> None:
    """In the order asked for, whatever blocks they lie in."""
    state = StateVector(cost_diagonal(random_ising(16)))
    state.evolve(SCHEDULE)
    asked = np.array([65_535, 3, 40_000, 3])
    p = np.abs(state.amplitudes()) ** 2
    assert state.probability_of(asked) == pytest.approx(p[asked], rel=1e-4)


def test_threads_do_not_change_the_result() -> None:
    """One thread and three give the same state, bit by bit."""
    diagonal = cost_diagonal(random_ising(18))
    states = [StateVector(diagonal, threads) for threads in (1, 3)]
    for state in states:
        state.evolve(SCHEDULE)
    assert np.array_equal(states[0].amplitudes(), states[1].amplitudes())


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (lambda: StateVector(np.zeros(3, dtype=np.float32)), "3 states"),
        (lambda: StateVector(np.zeros(4, dtype=np.float32)).evolve([]), "without layers"),
    ],
)
def test_nonsense_is_refused(make: Callable[[], object], problem: str) -> None:
    """No power of two, no layers."""
    with pytest.raises(ValueError, match=problem):
        make()


def test_memory_at_25_qubits_is_as_documented() -> None:
    """Below half a GiB, diagonal included."""
    assert memory_bytes(25) == 384 << 20
