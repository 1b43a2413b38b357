from __future__ import annotations

from collections.abc import Callable

import dimod
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.arc import build_arc_model
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.problem import ArcProblem, CandidateArc
from dispatcher_daemon.forms.subtours import order_rows
from slipstream_lab.research.proofs.enumeration import all_energies, enumerate_model

Demo = Callable[..., ArcProblem]


@pytest.mark.parametrize("block_bits", [2, 5, 9, 20])
def test_energies_agree_with_dimod_in_every_state(block_bits: int) -> None:
    """Doubling in blocks gives each state the energy that dimod gives it, in the stated order."""
    rng = np.random.default_rng(3)
    bqm = dimod.BinaryQuadraticModel("BINARY")
    names = [f"v{i}" for i in range(9)]
    for name in names:
        bqm.add_linear(name, rng.normal())
    for i in range(9):
        for j in range(i):
            if rng.random() < 0.6:
                bqm.add_quadratic(names[i], names[j], rng.normal())
    bqm.offset = 1.5
    found = np.concatenate(list(all_energies(bqm, names, block_bits)))
    states = (np.arange(512)[:, None] >> np.arange(9)) & 1
    assert found == pytest.approx(bqm.energies((states, names)), abs=1e-12)


def test_too_many_variables_are_refused() -> None:
    """Nobody waits for 2^31 states by mistake."""
    bqm = dimod.BinaryQuadraticModel(dict.fromkeys(range(31), 1.0), {}, "BINARY")
    with pytest.raises(ValueError, match="too many"):
        next(all_energies(bqm, range(31)))


@pytest.mark.long
@pytest.mark.parametrize(("y_e", "gamma"), [(1, None), (0, None), (1, 50.0)])
def test_demo_qubo_is_exact(demo_arcs: Demo, y_e: int, gamma: float | None) -> None:
    """All 2^25 states: zero penalty ⇔ valid routes, QUBO minimum = MILP optimum, γ separates."""
    problem = demo_arcs(avenue_east=1, avenue_west=y_e)
    found = enumerate_model(build_arc_model(problem, gamma))
    exact = solve_milp(problem, 10.0)
    assert found.states == 2**25
    assert found.mismatches == 0
    assert found.valid_selections == 6
    assert found.minimum_kwh == pytest.approx(exact.objective_kwh, abs=1e-7)
    assert found.minimum_selected == exact.selected
    assert found.separated


@pytest.mark.long
@pytest.mark.slow
def test_a_gamma_that_is_too_small_is_found_out(demo_arcs: Demo) -> None:
    """With γ = 0.05 kWh breaking rules pays, and the enumeration says so."""
    problem = demo_arcs(avenue_east=1, avenue_west=1)
    found = enumerate_model(build_arc_model(problem, 0.05))
    assert not found.separated
    assert found.minimum_kwh < (solve_milp(problem, 10.0).objective_kwh or 0.0) - 0.1
    assert found.mismatches == 0


def check_exact(problem: ArcProblem) -> None:
    """Enumeration, MILP and decoder agree on an instance."""
    model = build_arc_model(problem)
    found = enumerate_model(model)
    exact = solve_milp(problem, 10.0)
    assert found.mismatches == 0
    assert found.separated
    if exact.objective_kwh is None:
        assert found.valid_selections == 0
    else:
        assert found.minimum_kwh == pytest.approx(exact.objective_kwh, abs=1e-7)


@pytest.mark.slow
@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), shape=st.sampled_from([(2, 1), (3, 1), (2, 2), (3, 2), (4, 2)]))
def test_any_small_instance_is_exact(random_arcs: Demo, seed: int, shape: tuple[int, int]) -> None:
    """Random sparse instances, infeasible ones and heavy rewards included, are exact as well."""
    problem = random_arcs(seed, *shape, max_arcs=11)
    if len(build_arc_model(problem).variables) <= 20:
        check_exact(problem)


def ring(pairs: list[tuple[str, str]]) -> ArcProblem:
    """One vehicle that must start with c4: c1, c2 and c3 could close a cycle of their own."""
    depot_arcs = [("d", "c4"), ("c4", "d"), ("c4", "c1"), ("c3", "d")]
    arcs = tuple(
        CandidateArc("v", i, j, 0.1 + 0.01 * n) for n, (i, j) in enumerate(depot_arcs + pairs)
    )
    return ArcProblem("d", ("c1", "c2", "c3", "c4"), ("v",), arcs)


@pytest.mark.slow
def test_cycles_of_three_are_excluded_by_general_rows() -> None:
    """A component of three stops gets MTZ rows with M = 3 and slack 0..4; the model is exact."""
    problem = ring([("c1", "c2"), ("c2", "c3"), ("c3", "c1")])
    rows = [row for row in order_rows(problem) if row.slack]
    assert [(row.weight, row.constant, row.slack) for row in rows] == [(3, -2, (1, 2, 4))] * 3
    model = build_arc_model(problem)
    assert len(model.variables) == 7 + 8 + 9
    check_exact(problem)


def test_no_rows_where_no_cycle_fits() -> None:
    """Two vehicles and three stops leave no two stops for a cycle: no slack bits are spent."""
    pairs = [("d", "a"), ("a", "d"), ("a", "b"), ("b", "a"), ("b", "d"), ("d", "c"), ("c", "d")]
    arcs = tuple(CandidateArc(k, i, j, 0.1) for k in ("v", "w") for i, j in pairs)
    problem = ArcProblem("d", ("a", "b", "c"), ("v", "w"), arcs)
    assert not any(row.slack for row in order_rows(problem))
    check_exact(problem)
