from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.decode import decode
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.problem import ArcProblem
from dispatcher_daemon.solvers.insertion import cheapest_insertion


def test_demo_gets_a_valid_plan(demo_arcs: Callable[..., ArcProblem]) -> None:
    """The demo never lacks a plan, whatever happens to the solvers."""
    problem = demo_arcs(avenue_east=1)
    selected = cheapest_insertion(problem)
    assert selected is not None
    assert decode(problem, selected).routes is not None


@pytest.mark.slow
@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), customers=st.integers(1, 4), vehicles=st.integers(1, 2))
def test_what_it_finds_is_valid_and_no_better_than_the_optimum(
    random_arcs: Callable[..., ArcProblem], seed: int, customers: int, vehicles: int
) -> None:
    """On any instance it gives a valid plan or none, and no plan only beats the exact optimum."""
    problem = random_arcs(seed, customers, vehicles, 24).without_platooning()
    selected = cheapest_insertion(problem)
    if selected is not None:
        assert decode(problem, selected).routes is not None
        best = solve_milp(problem, 10.0).objective_kwh
        assert best is not None
        assert problem.objective_kwh(selected) >= best - 1e-9
