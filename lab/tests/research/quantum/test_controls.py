from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import RouteProblem
from dispatcher_daemon.solvers.distribution import BitDistribution
from dispatcher_daemon.solvers.protocol import Outcome, Samples
from slipstream_lab.research.proofs.enumeration import all_energies
from slipstream_lab.research.quantum.controls import (
    STAGES,
    UNIFORM_BITS,
    UNIFORM_OPTIONS,
    difference,
    distributions,
    run_controls,
    shares,
)

Routes = Callable[..., RouteProblem]

NOTHING = Outcome("x", "failed", None, 0.0)


def test_uniform_bits_are_feasible_as_often_as_states_are(random_routes: Routes) -> None:
    """The control's raw share is the share of valid states, which enumeration counts."""
    model = build_model(random_routes(3, [2, 2, 2], 2))
    penalty = np.concatenate(list(all_energies(model.penalty, model.variables)))
    valid = float((penalty < 0.5).mean())
    found = run_controls(model, distributions(model, NOTHING), 20_000, 1)
    share = shares(found[UNIFORM_BITS], "raw", None).p_feasible
    assert share == pytest.approx(valid, abs=4 * math.sqrt(valid / 20_000))
    assert shares(found[UNIFORM_OPTIONS], "raw", None).p_feasible > share


def test_a_warm_start_is_sampled_without_the_circuit(random_routes: Routes) -> None:
    """A distribution that holds the answer finds it at every stage: no circuit gets the credit."""
    problem = random_routes(3, [3, 3], 1)
    exact = solve_milp(problem, 5.0)
    assert exact.selected is not None
    chosen = BitDistribution(tuple(float(i in exact.selected) for i in range(6)))
    model = build_model(problem)
    outcome = replace(NOTHING, controls=(("warm start", chosen),))
    found = run_controls(model, distributions(model, outcome), 200, 1)
    assert set(found) == {UNIFORM_BITS, UNIFORM_OPTIONS, "warm start"}
    for stage in STAGES:
        of_stage = shares(found["warm start"], stage, exact.objective_kwh)
        assert (of_stage.p_feasible, of_stage.p_optimal) == (1.0, 1.0)
        assert of_stage.best_kwh == pytest.approx(exact.objective_kwh, abs=1e-8)


def test_controls_repeat_with_their_seed(random_routes: Routes) -> None:
    """One seed, one control; each distribution has a stream of its own."""
    model = build_model(random_routes(5, [3, 2], 1))
    of = {"a": BitDistribution((0.5,) * 5), "b": BitDistribution((0.5,) * 5)}
    one, two = (run_controls(model, of, 300, 4) for _ in range(2))
    assert one == two
    assert one["a"] != one["b"]


def test_differences_have_sign_and_error() -> None:
    """Positive where the circuit does better; the error shrinks with shots and is never 0."""
    better = difference(0.5, 1000, 0.2, 1000)
    assert better.value == pytest.approx(0.3)
    assert better.standard_error == pytest.approx(math.sqrt(0.25 / 1e3 + 0.16 / 1e3), rel=0.01)
    assert difference(0.1, 1000, 0.2, 1000).value == pytest.approx(-0.1)
    assert 0 < difference(0.0, 100, 0.0, 100).standard_error < 0.02
    assert difference(0.5, 10, 0.5, 10).standard_error > better.standard_error


def test_unknown_optima_have_no_share() -> None:
    """Without an optimum there is no P_opt; without a valid shot there is no best objective."""
    samples = Samples(3, 10, (), ((1.0, 2), (2.0, 1)), ((1.0, 5),))
    raw, descended = shares(samples, "raw", None), shares(samples, "descended", 1.0)
    assert (raw.p_feasible, raw.p_optimal, raw.best_kwh) == (0.0, None, None)
    assert (descended.p_feasible, descended.p_optimal, descended.best_kwh) == (0.3, 0.2, 1.0)
