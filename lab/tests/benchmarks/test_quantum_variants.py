from __future__ import annotations

import math

import pytest

from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers.quantum import prepare_model, to_ising
from dispatcher_daemon.solvers.quantum.chain import ChainState
from slipstream_lab.benchmarks.quantum.variants import (
    _cvar,
    case_of,
    prepared_as,
    score,
    survival,
)


def problem() -> RouteProblem:
    """Two vehicles with two options each; meeting on their second ones is best."""
    costs = ((0, 1.0), (0, 1.1), (1, 1.0), (1, 1.15))
    options = tuple(RouteOption(f"v{k}", (f"s{k}",), cost) for k, cost in costs)
    return RouteProblem(("v0", "v1"), ("s0", "s1"), options, {(1, 3): 0.5})


def test_scores_of_a_product_state_are_those_of_its_bits() -> None:
    """Without entangling gates the control is the circuit itself, to the last digit."""
    case = case_of("two", problem())
    assert (len(case.valid), case.best.sum()) == (4, 1)
    assert case.valid[case.best].tolist() == [[0, 1, 0, 1]]
    for variant, feasible in (("product", None), ("one-hot-product", 1.0)):
        settings = LcQaoaSettings.model_validate({"variant": variant, "iterations": 3})
        prepared = prepare_model(case.model, settings, seed=1, deadline=math.inf, restarts=1)
        found = score(case, prepared)
        assert found.optimal == pytest.approx(found.independent)
        assert 0 < found.optimal < found.feasible <= 1 + 1e-9
        if feasible is not None:
            assert found.feasible == pytest.approx(feasible)


def test_error_free_share_counts_two_gates_for_each_coupling() -> None:
    """Four readouts, and two CZ for each of the six RZZ gates of two layers."""
    settings = LcQaoaSettings(variant="multi-angle", iterations=1)
    case = case_of("two", problem())
    prepared = prepare_model(case.model, settings, seed=1, deadline=math.inf)
    assert survival(prepared) == pytest.approx((1 - 0.0013) ** 12 * (1 - 0.005) ** 4)


def test_order_and_objective_can_be_chosen() -> None:
    """A drawn order depends on the seed alone; CVaR of all samples is their mean."""
    model = case_of("two", problem()).model
    orders = [prepared_as(model, "ramp", seed, random=True).order for seed in (1, 1, 2)]
    assert orders[0] == orders[1] != orders[2]
    assert prepared_as(model, "trained", 1, cvar=0.5).evaluations > 1
    ansatz = prepared_as(model, "ramp", 1).ansatz
    ising = to_ising(model.total, model.variables)
    z = 1.0 - 2.0 * ChainState(ansatz).sample(1024, 9)
    drawn = ising.offset + z @ ising.h + ((z @ ising.coupling) * z).sum(axis=1) / 2
    assert _cvar(ising, 1.0, 9)(ansatz) == pytest.approx(drawn.mean())
    assert _cvar(ising, 1e-6, 9)(ansatz) == pytest.approx(drawn.min())
