from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.arc import (
    ArcVariable,
    OrderBit,
    SlackBit,
    build_arc_model,
    sufficient_gamma,
)
from dispatcher_daemon.forms.problem import ArcProblem, ArcReward, CandidateArc

Demo = Callable[..., ArcProblem]


def test_demo_has_exactly_25_variables(demo_arcs: Demo) -> None:
    """16 arcs, 8 order bits shared by the vehicles and 1 slack bit, the paper's counts."""
    model = build_arc_model(demo_arcs(avenue_east=1, avenue_west=1))
    kinds = Counter(type(v) for v in model.variables)
    assert kinds == {ArcVariable: 16, OrderBit: 8, SlackBit: 1}
    assert len(set(map(str, model.variables))) == 25
    touched = {v for pair in model.penalty.quadratic for v in pair}
    assert touched == set(model.variables)


def arcs_on(
    state: dict[object, int], vehicle: str | None, start: str | None, end: str | None
) -> int:
    """Sum of x over the arcs that match; None matches any."""
    return sum(
        value
        for v, value in state.items()
        if isinstance(v, ArcVariable)
        and vehicle in (None, v.vehicle)
        and start in (None, v.start)
        and end in (None, v.end)
    )


def degrees_in_words(state: dict[object, int]) -> int:
    """H_cust + H_flow + H_depot of the demo written out, without the builder."""
    customers, vans = ("c1", "c2", "c3", "c4"), ("van-a", "van-b")

    def x(vehicle: str | None, start: str | None, end: str | None) -> int:
        return arcs_on(state, vehicle, start, end)

    cust = sum((x(None, None, c) - 1) ** 2 for c in customers)
    flow = sum((x(k, None, c) - x(k, c, None)) ** 2 for k in vans for c in customers)
    depot = sum((x(k, "depot", None) - 1) ** 2 + (x(k, None, "depot") - 1) ** 2 for k in vans)
    return cust + flow + depot


def order_in_words(state: dict[object, int]) -> int:
    """The demo's order rows written out."""

    def u(customer: str) -> int:
        return state[OrderBit(customer, 0)] + 2 * state[OrderBit(customer, 1)]

    def x(start: str, end: str) -> int:
        return arcs_on(state, None, start, end)

    w = state[SlackBit("c2", "c4", 0)]
    return (
        (u("c2") - u("c4") + 2 * x("c2", "c4") - 1 + 2 * w) ** 2
        + (u("c4") - u("c2") + 2 * x("c4", "c2") - 1) ** 2
        + (u("c1") - u("c2") + x("c1", "c2")) ** 2
        + (u("c3") - u("c2") + x("c3", "c2")) ** 2
    )


@pytest.mark.nightly
@given(bits=st.lists(st.integers(0, 1), min_size=25, max_size=25))
def test_demo_model_is_the_formula(demo_arcs: Demo, bits: list[int]) -> None:
    """In any state the QUBO's parts equal the formulas written out by hand."""
    problem = demo_arcs(avenue_east=1, avenue_west=1)
    model = build_arc_model(problem)
    state: dict[object, int] = dict(zip(model.variables, bits, strict=True))
    penalty = degrees_in_words(state) + order_in_words(state)
    objective = problem.objective_kwh(model.selected(bits))
    assert model.penalty.energy(state) == pytest.approx(penalty, abs=1e-9)
    assert model.objective.energy(state) == pytest.approx(objective, abs=1e-12)
    assert model.total.energy(state) == pytest.approx(objective + model.gamma * penalty, abs=1e-9)


def full_subtour_in_words(state: dict[object, int]) -> int:
    """H_subtour of the paper for 4 customers and 2 vehicles, on the demo's candidate arcs."""
    total = 0
    for k in ("van-a", "van-b"):

        def u(customer: str, k: str = k) -> int:
            return state[OrderBit(customer, 0, k)] + 2 * state[OrderBit(customer, 1, k)]

        for i in ("c1", "c2", "c3", "c4"):
            for j in ("c1", "c2", "c3", "c4"):
                if ArcVariable(k, i, j) in state:
                    slack = sum(2**m * state[SlackBit(i, j, m, k)] for m in range(3))
                    total += (u(i) - u(j) + 4 * state[ArcVariable(k, i, j)] - 4 + 1 + slack) ** 2
    return total


@pytest.mark.long
@given(bits=st.lists(st.integers(0, 1), min_size=56, max_size=56))
def test_full_encoding_is_the_papers_formula(demo_arcs: Demo, bits: list[int]) -> None:
    """K·N·⌈log2 N⌉ order bits; MTZ for each vehicle and arc, with slack 0..6 in three bits."""
    problem = demo_arcs(avenue_east=1, avenue_west=1)
    model = build_arc_model(problem, 2.0, "full")
    kinds = Counter(type(v) for v in model.variables)
    assert kinds == {ArcVariable: 16, OrderBit: 2 * 4 * 2, SlackBit: 8 * 3}
    state: dict[object, int] = dict(zip(model.variables, bits, strict=True))
    expected = degrees_in_words(state) + full_subtour_in_words(state)
    assert model.penalty.energy(state) == pytest.approx(expected, abs=1e-9)
    assert model.objective.energy(state) == pytest.approx(
        problem.objective_kwh(model.selected(bits)), abs=1e-12
    )
    assert len(set(map(str, model.variables))) == 56


def test_gamma_can_be_set(demo_arcs: Demo) -> None:
    """The paper's γ = 50 is kept if asked for."""
    problem = demo_arcs(avenue_east=1)
    assert build_arc_model(problem, 50.0).gamma == 50.0
    assert build_arc_model(problem).gamma == sufficient_gamma(problem)


@settings(max_examples=50)
@given(seed=st.integers(0, 10**6))
def test_computed_gamma_exceeds_any_spread_of_the_objective(random_arcs: Demo, seed: int) -> None:
    """γ is more than the dearest possible route set costs over the cheapest selection of all."""
    problem = random_arcs(seed, 3, 2, 12)
    n = len(problem.arcs)
    values = np.zeros(1)
    chosen = np.zeros((1, n), dtype=bool)
    for i in range(n):
        on = chosen.copy()
        on[:, i] = True
        partners = [
            (b if a == i else a, s) for (a, b), s in problem.pair_savings.items() if i in (a, b)
        ]
        extra = problem.arcs[i].cost_kwh - sum(
            (chosen[:, j] * s for j, s in partners), np.zeros(len(chosen))
        )
        values = np.concatenate([values, values + extra])
        chosen = np.concatenate([chosen, on])
    degree_ok = np.all(
        [chosen[:, [a.end == c for a in problem.arcs]].sum(axis=1) == 1 for c in problem.customers]
        + [
            chosen[:, [(a.vehicle, a.end) == (k, "d") for a in problem.arcs]].sum(axis=1) == 1
            for k in problem.vehicles
        ],
        axis=0,
    )
    if degree_ok.any():
        assert sufficient_gamma(problem) > values[degree_ok].max() - values.min()


def test_rewards_beyond_costs_raise_gamma() -> None:
    """Where platooning could pay more than driving costs, the bound takes it into account."""
    arcs = (
        CandidateArc("v", "d", "a", 0.1),
        CandidateArc("v", "a", "d", 0.1),
        CandidateArc("w", "d", "b", 0.1),
        CandidateArc("w", "b", "d", 0.1),
    )
    plain = ArcProblem("d", ("a", "b"), ("v", "w"), arcs)
    rich = ArcProblem("d", ("a", "b"), ("v", "w"), arcs, (ArcReward(0, 2, "e", 5.0),))
    assert sufficient_gamma(rich) > sufficient_gamma(plain) + 4.5
