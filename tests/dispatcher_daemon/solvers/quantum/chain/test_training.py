from __future__ import annotations

import time

import numpy as np
import pytest

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.chain.batched_lbfgs import minimise
from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz
from dispatcher_daemon.solvers.quantum.chain.state import ChainState
from dispatcher_daemon.solvers.quantum.chain.training import (
    around,
    mean_energy,
    train_angles,
    train_schedule,
)
from dispatcher_daemon.solvers.quantum.ising import Ising

RAMP = linear_ramp(2, 0.3, 0.6)


def spin_glass(seed: int, n: int) -> Ising:
    """All couplings."""
    rng = np.random.default_rng(seed)
    coupling = np.triu(rng.normal(size=(n, n)), 1)
    return Ising(rng.normal(size=n), coupling + coupling.T, 0.0).normalised()


def lowest(ising: Ising) -> float:
    """The ground state's energy, by looking at all states."""
    n = len(ising.h)
    bits = ((np.arange(1 << n)[:, None] >> np.arange(n)) & 1).astype(np.int8)
    z = 1.0 - 2.0 * bits
    return float((z @ ising.h + ((z @ ising.coupling) * z).sum(axis=1) / 2).min())


def quadratics(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ c_i (x_i − i)² with curvatures from 1 to 1000."""
    curvatures = np.geomspace(1, 1000, points.shape[1])
    away = points - np.arange(points.shape[1])
    return (curvatures * away**2).sum(axis=1), 2 * curvatures * away


def rosenbrock(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The bent valley in two dimensions."""
    x, y = points.T
    bend = y - x**2
    values = (1 - x) ** 2 + 100 * bend**2
    return values, np.stack([-2 * (1 - x) - 400 * x * bend, 200 * bend], axis=1)


def test_batch_of_problems_finds_each_ones_minimum() -> None:
    """Badly scaled bowls and a bent valley, from several starts, each with its own step."""
    rng = np.random.default_rng(1)
    bowls = minimise(quadratics, rng.normal(size=(7, 6)) * 10, 200)
    assert bowls.points == pytest.approx(np.tile(np.arange(6.0), (7, 1)), abs=1e-2)
    valley = minimise(rosenbrock, np.array([[-1.2, 1.0], [2.0, 2.0], [0.0, 0.0]]), 300)
    assert valley.points == pytest.approx(np.ones((3, 2)), abs=1e-2)
    assert rosenbrock(valley.points)[0] == pytest.approx(valley.values)
    assert valley.evaluations < 900


def test_schedule_gets_below_the_ramp_and_keeps_the_best() -> None:
    """What comes back is the best that was looked at, within the allowed evaluations."""
    ising = spin_glass(1, 9)
    seen: list[float] = []

    def objective(ansatz: Ansatz) -> float:
        seen.append(mean_energy(ising)(ansatz))
        return seen[-1]

    found = train_schedule(lambda s: scheduled(ising, s), objective, RAMP, evaluations=25)
    assert found.evaluations == len(seen) <= 25
    assert found.value == min(seen) < seen[0] - 0.2
    assert ChainState(found.circuit).energy(ising) == pytest.approx(found.value)


@pytest.mark.slow
def test_an_angle_for_each_gate_finds_the_ground_state_of_a_small_model() -> None:
    """Trained to the answer: the best of eight starts is the ground state nearly alone."""
    ising = spin_glass(3, 8)
    starts = around(scheduled(ising, RAMP), 0.5, 8, seed=1)
    found = train_angles(starts, ising, iterations=60)
    assert found.value == pytest.approx(lowest(ising), abs=1e-2)
    assert ChainState(found.circuit).energy(ising) == pytest.approx(found.value)
    again = train_angles(starts, ising, iterations=60)
    assert again.value == found.value


def test_closed_bonds_stay_closed() -> None:
    """A cut bond gets no gate; without entangling gates the state is a product."""
    ising = spin_glass(4, 7)
    starts = around(scheduled(ising, RAMP), 0.5, 2, seed=1)
    cut = train_angles(starts, ising, iterations=15, cuts=[2, 5]).circuit
    assert isinstance(cut, ChainAnsatz)
    assert np.all(cut.bonds[:, [2, 5]] == 0)
    assert np.all(cut.bonds[:, [0, 1, 3, 4]] != 0)
    flat = train_angles(starts, ising, iterations=3, entangled=False).circuit
    assert isinstance(flat, ChainAnsatz)
    assert np.all(flat.bonds == 0)


def test_deadline_that_is_over_still_gives_a_circuit() -> None:
    """One evaluation is made, and its circuit is the answer; the rest of the time is not used."""
    ising = spin_glass(5, 8)
    began = time.perf_counter()
    starts = around(scheduled(ising, RAMP), 0.5, 3, seed=1)
    found = train_angles(starts, ising, iterations=10**6, deadline=began)
    assert found.evaluations == 1
    one = train_schedule(
        lambda s: scheduled(ising, s), mean_energy(ising), RAMP, evaluations=10**6, deadline=began
    )
    assert one.evaluations == 1
    assert time.perf_counter() - began < 5


def test_a_deadline_far_away_changes_nothing() -> None:
    """How many starts go together is a matter of time, not of the result."""
    ising = spin_glass(5, 8)
    starts = around(scheduled(ising, RAMP), 0.5, 3, seed=1)
    free = train_angles(starts, ising, iterations=10)
    timed = train_angles(starts, ising, iterations=10, deadline=time.perf_counter() + 600)
    assert (timed.value, timed.evaluations) == (pytest.approx(free.value), free.evaluations)


@pytest.mark.slow
def test_five_hundred_qubits_train() -> None:
    """Two steps lower the energy of a long chain with couplings beyond its neighbours."""
    rng = np.random.default_rng(1)
    n = 500
    coupling = np.zeros((n, n))
    for distance in (1, 2, 20):
        i = np.arange(n - distance)
        coupling[i, i + distance] = coupling[i + distance, i] = rng.normal(size=n - distance)
    ising = Ising(rng.normal(size=n), coupling, 0.0).normalised()
    start = scheduled(ising, linear_ramp(1, 0.3, 0.6))
    found = train_angles([start], ising, iterations=3)
    assert found.value < mean_energy(ising)(start)
