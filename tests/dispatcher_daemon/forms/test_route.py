from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.forms.route import sufficient_route_gamma
from slipstream_lab.research.proofs.enumeration import enumerate_model, valid_selections

Routes = Callable[..., RouteProblem]

TWO = RouteProblem(
    ("v", "w"),
    ("a", "b", "c"),
    (
        RouteOption("v", ("a", "b"), 1.0),
        RouteOption("v", ("b", "a"), 1.1),
        RouteOption("v", ("a",), 0.7),
        RouteOption("w", ("c",), 0.5),
        RouteOption("w", ("c", "b"), 0.9),
    ),
    {(1, 3): 0.2, (2, 4): 0.05},
)


@given(bits=st.lists(st.integers(0, 1), min_size=5, max_size=5))
def test_model_is_the_formula(bits: list[int]) -> None:
    """In any state objective and penalty equal what is written out by hand."""
    model = build_model(TWO)
    state = dict(zip(model.variables, bits, strict=True))
    x0, x1, x2, x3, x4 = bits
    penalty = (x0 + x1 + x2 - 1) ** 2 + (x3 + x4 - 1) ** 2 + (x0 + x1 + x4 - 1) ** 2
    cost = x0 + 1.1 * x1 + 0.7 * x2 + 0.5 * x3 + 0.9 * x4 - 0.2 * x1 * x3 - 0.05 * x2 * x4
    assert model.penalty.energy(state) == penalty
    assert model.objective.energy(state) == pytest.approx(cost, abs=1e-12)
    assert TWO.objective_kwh(model.selected(bits)) == pytest.approx(cost, abs=1e-12)
    assert model.total.energy(state) == pytest.approx(cost + model.gamma * penalty, abs=1e-9)
    assert (penalty == 0) == (violations(TWO, model.selected(bits)) == ())


def test_an_option_that_costs_more_can_be_the_best() -> None:
    """The dearer order of v's stops meets w and is chosen; without platooning it is not."""
    assert solve_milp(TWO, 5.0).selected == frozenset({1, 3})
    assert solve_milp(TWO.without_platooning(), 5.0).selected == frozenset({0, 3})


def brute_force(problem: RouteProblem) -> float | None:
    """Least objective over all ways to take one option each that serve every stop once."""
    values = []
    for chosen in product(*problem.options_of.values()):
        served = [stop for i in chosen for stop in problem.options[i].stops]
        if sorted(served) == sorted(problem.stops):
            values.append(problem.objective_kwh(chosen))
    return min(values, default=None)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    options=st.lists(st.integers(1, 4), min_size=1, max_size=4),
    stops=st.integers(0, 4),
)
def test_any_small_instance_is_exact(
    random_routes: Routes, seed: int, options: list[int], stops: int
) -> None:
    """QUBO, MILP, decoder and trying everything agree, with losses and negative costs as well."""
    problem = random_routes(seed, options, stops)
    found = enumerate_model(build_model(problem))
    exact = solve_milp(problem, 10.0)
    expected = brute_force(problem)
    assert found.mismatches == 0
    assert found.separated
    if expected is None:
        assert exact.status == "infeasible"
        assert found.feasible_states == 0
    else:
        assert exact.status == "optimal"
        assert exact.objective_kwh == pytest.approx(expected, abs=1e-7)
        assert found.minimum_kwh == pytest.approx(expected, abs=1e-7)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [3, 8])
def test_five_vehicles_of_five_options_are_exact(random_routes: Routes, seed: int) -> None:
    """25 variables dispatch five vehicles: all 2^25 states agree with the MILP."""
    problem = random_routes(seed, [5] * 5, 6)
    found = enumerate_model(build_model(problem))
    assert found.states == 2**25
    assert found.mismatches == 0
    assert found.separated
    assert found.minimum_selected == solve_milp(problem, 10.0).selected


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_counting_bits_judges_as_the_decoder_does(random_routes: Routes, seed: int) -> None:
    """The quick judgement of all selections is that of the decoder, one by one."""
    problem = random_routes(seed, [3, 2, 3], 3)
    valid = valid_selections(problem)
    for number, verdict in enumerate(valid):
        selected = [i for i in range(problem.choices) if number >> i & 1]
        assert verdict == (not violations(problem, selected))


def test_gamma_can_be_set_and_one_too_small_is_found_out() -> None:
    """The paper's γ = 50 separates as well; with γ = 0.01 kWh breaking rules pays."""
    assert enumerate_model(build_model(TWO, 50.0)).separated
    assert build_model(TWO, 50.0).gamma == 50.0
    found = enumerate_model(build_model(TWO, 0.01))
    assert not found.separated
    assert violations(TWO, found.minimum_selected)


def test_gamma_is_the_spread_and_one_vehicle_not_the_whole_cost() -> None:
    """With many like options γ stays near one route's cost, however many vehicles there are."""
    fleet = tuple(f"v{k}" for k in range(40))
    options = tuple(RouteOption(k, (), 2.0 + 0.001 * r) for k in fleet for r in range(3))
    gamma = sufficient_route_gamma(RouteProblem(fleet, (), options))
    assert 2.0 < gamma < 2.2


def test_losses_count_in_gamma() -> None:
    """A loss between two options lifts what a feasible state may cost."""
    plain = RouteProblem(("v", "w"), (), (RouteOption("v", (), 1.0), RouteOption("w", (), 1.0)))
    lossy = replace(plain, savings={(0, 1): -3.0})
    assert sufficient_route_gamma(lossy) > sufficient_route_gamma(plain) + 2.9
    assert solve_milp(lossy, 5.0).objective_kwh == pytest.approx(5.0)


def test_faults_are_named() -> None:
    """No option, two of them, and stops left out or served twice are said in words."""
    assert violations(TWO, {0}) == ("w: 0 options selected",)
    assert violations(TWO, {0, 1, 3}) == ("v: 2 options selected",)
    assert violations(TWO, {2, 3}) == ("b: served 0 times",)
    assert violations(TWO, {0, 4}) == ("b: served 2 times",)
