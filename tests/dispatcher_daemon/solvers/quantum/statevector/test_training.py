from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dispatcher_daemon.forms.model import QuboModel, build_model
from dispatcher_daemon.planning.arc_form.arcs import arc_problem_of
from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp
from dispatcher_daemon.solvers.quantum.ising import to_ising
from dispatcher_daemon.solvers.quantum.statevector.diagonal import cost_diagonal
from dispatcher_daemon.solvers.quantum.statevector.exact_state import Schedule
from dispatcher_daemon.solvers.quantum.statevector.training import Objective, train
from dispatcher_daemon.solvers.quantum.statevector.transverse import StateVector
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.quantum.ideal import dense_qaoa_figures, valid_selections_of


def published(name: str) -> QuboModel:
    """The arc form's QUBO of a published instance."""
    instance = open_instance(name)
    return build_model(arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s))


def state_of(name: str) -> StateVector:
    """A state over its normalised Hamiltonian."""
    model = published(name)
    return StateVector(cost_diagonal(to_ising(model.total, model.variables).normalised()))


@pytest.fixture(scope="module")
def avenue() -> StateVector:
    """14 qubits."""
    return state_of("arc14-avenue")


@pytest.mark.parametrize("alpha", [1.0, 0.1])
def test_training_lowers_its_objective(avenue: StateVector, alpha: float) -> None:
    """The best value is that of the angles returned, which the state is left at."""
    objective = Objective(alpha)
    found = train(avenue, linear_ramp(2, 0.3, 0.6), objective, evaluations=30)
    assert found.evaluations == len(found.history) <= 30
    assert found.value == min(found.history) < found.history[0]
    assert objective(avenue) == pytest.approx(found.value)
    avenue.evolve(found.schedule)
    assert objective(avenue) == pytest.approx(found.value)
    again = train(avenue, linear_ramp(2, 0.3, 0.6), objective, evaluations=30)
    assert again.history == found.history


def test_heights_of_a_ramp_are_two_angles(avenue: StateVector) -> None:
    """Only ramps are tried; five layers need no more evaluations than one."""
    found = train(avenue, linear_ramp(5, 0.3, 0.6), angles="ramp", evaluations=40)
    heights = found.schedule[0][0], found.schedule[-1][1]
    assert np.array(found.schedule) == pytest.approx(np.array(linear_ramp(5, *heights)))
    assert found.value < found.history[0]


@pytest.mark.parametrize("evaluations", [1, 3])
def test_evaluations_are_bounded(avenue: StateVector, evaluations: int) -> None:
    """Even below the number of angles."""
    found = train(avenue, linear_ramp(3, 0.3, 0.6), evaluations=evaluations)
    assert found.evaluations == evaluations
    assert found.ended == "evaluations"


def test_deadline_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """No evaluation begins that would end too late; the first one always is made."""
    now_s = 100.0

    class Slow(StateVector):
        def evolve(self, schedule: Schedule) -> None:
            nonlocal now_s
            now_s += 0.05
            super().evolve(schedule)

    clock = SimpleNamespace(perf_counter=lambda: now_s)
    monkeypatch.setattr("dispatcher_daemon.solvers.quantum.statevector.training.time", clock)
    model = published("arc08-blocks")
    slow = Slow(cost_diagonal(to_ising(model.total, model.variables).normalised()))
    found = train(slow, linear_ramp(2, 0.3, 0.6), deadline=100.4)
    assert 100.2 < now_s <= 100.4
    assert found.ended == "deadline"
    assert 4 < found.evaluations < 8
    assert train(slow, linear_ramp(2, 0.3, 0.6), deadline=100.0).evaluations == 1


@pytest.mark.parametrize("alpha", [0.0, 1.1, float("nan")])
def test_share_is_above_0_and_at_most_1(alpha: float) -> None:
    """Any other CVaR is refused."""
    with pytest.raises(ValueError, match="alpha"):
        Objective(alpha)


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
    trained = dense_qaoa_figures(model, [(0.35, 0.8)], evaluations=20, alpha=0.1)
    assert trained.evaluations <= 20
    assert trained.p_feasible > flat.p_feasible
