"""Training of dense QAOA on its exact state, and its figures."""

from __future__ import annotations

import time

import numpy as np
import pytest

from dispatcher_daemon.forms import QuboModel, build_model
from dispatcher_daemon.solvers.quantum import linear_ramp, to_ising
from dispatcher_daemon.solvers.quantum.statevector import StateVector, cost_diagonal
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.quantum.angles import QaoaOptions, cvar, make_qaoa, train
from slipstream_lab.research.quantum.ideal import dense_qaoa_figures, valid_selections_of

RAMP = linear_ramp(2, 0.3, 0.6)


def published(name: str) -> QuboModel:
    """The arc form's QUBO of a published instance."""
    return build_model(arc_form_of(open_instance(name)).problem)


def state_of(name: str) -> StateVector:
    """A state over its normalised Hamiltonian."""
    model = published(name)
    return StateVector(cost_diagonal(to_ising(model.total, model.variables).normalised()))


@pytest.mark.parametrize("alpha", [1.0, 0.1])
def test_training_lowers_its_objective(alpha: float) -> None:
    """The state is left at the angles returned, within the allowed evaluations; a seed-free walk
    repeats.
    """
    state = state_of("arc08-blocks")
    state.evolve(RAMP)
    start = cvar(state, alpha)
    found, evaluations = train(state, RAMP, alpha, evaluations=30)
    assert evaluations <= 30
    reached = cvar(state, alpha)
    assert reached < start
    state.evolve(found)
    assert cvar(state, alpha) == pytest.approx(reached)
    assert train(state, RAMP, alpha, evaluations=30)[0] == found
    assert train(state, RAMP, deadline=time.perf_counter())[1] == 1


def test_cvar_is_that_of_the_sorted_states() -> None:
    """The same as sorting all energies and cutting the mass at α by hand; at 1 the mean."""
    state = state_of("arc08-blocks")
    state.evolve(RAMP)
    cost = state.diagonal.astype(float)
    p = np.abs(state.amplitudes().astype(complex)) ** 2
    order = np.argsort(cost)
    p, cost = p[order] / p.sum(), cost[order]
    for alpha in (0.01, 0.5):
        taken = np.diff(np.minimum(np.cumsum(p), alpha), prepend=0.0)
        assert cvar(state, alpha) == pytest.approx(taken @ cost / alpha, abs=1e-4)
    assert cvar(state, 1.0) == pytest.approx(state.mean(), abs=1e-5)


def test_a_trained_solver_answers() -> None:
    """As many layers and shots as asked for; a seed gives one answer."""
    problem = published("arc08-blocks").problem
    solver = make_qaoa(QaoaOptions(layers=1, shots=64, iterations=5))
    first, second = (solver.solve(problem, 10.0, 7) for _ in range(2))
    assert first.execution is not None
    assert first.samples is not None
    assert (first.execution.layers, first.samples.shots) == (1, 64)
    assert (first.selected, first.samples) == (second.selected, second.samples)


def test_ideal_figures_are_those_of_the_marked_states() -> None:
    """P_feas and P_opt against the decoder asked state by state; without angles, as uniform."""
    model = published("arc08-blocks")
    selections = valid_selections_of(model)
    figures = dense_qaoa_figures(model, [(0.35, 0.8)])
    state = state_of("arc08-blocks")
    state.evolve([(0.35, 0.8)])
    p = np.abs(state.amplitudes()) ** 2
    of_selection = p.reshape(-1, 1 << selections.choices).sum(axis=0)
    assert figures.p_feasible == pytest.approx(of_selection[selections.valid].sum(), rel=1e-4)
    assert figures.p_optimal == pytest.approx(
        of_selection[selections.valid[selections.optimal]].sum(), rel=1e-4
    )
    flat = dense_qaoa_figures(model, [(0.0, 0.0)])
    assert flat.p_feasible == pytest.approx(flat.uniform_feasible, rel=1e-4)
    assert flat.p_optimal == pytest.approx(flat.uniform_optimal, rel=1e-4)
