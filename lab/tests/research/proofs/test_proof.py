from __future__ import annotations

from dataclasses import fields, replace

import dimod
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import ArcProblem, CandidateArc, Problem
from dispatcher_daemon.forms.qubo import Encoding, QuboModel
from dispatcher_daemon.planning.arc_form.arcs import arc_problem_of
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.random_problems import (
    random_arc_problem,
    random_route_problem,
)
from slipstream_lab.research.proofs import proof as proof_module
from slipstream_lab.research.proofs.eliminate import eliminate
from slipstream_lab.research.proofs.enumeration import (
    Exactness,
    enumerate_model,
    valid_selections,
)
from slipstream_lab.research.proofs.proof import can_prove, prove

SEEDS = st.integers(0, 10**9)
GAMMAS = st.sampled_from([None, 50.0])


@settings(max_examples=30)
@given(seed=SEEDS, gamma=GAMMAS)
def test_any_arc_problem_is_exact(seed: int, gamma: float | None) -> None:
    """Random arc problems, reduced encoding: every state looked at, nothing to object to."""
    found = prove(random_arc_problem(np.random.default_rng(seed), 18), gamma)
    assert found.faults() == ()
    assert found.holds


@settings(max_examples=15)
@given(seed=SEEDS, gamma=GAMMAS)
def test_any_arc_problem_is_exact_by_the_papers_rows(seed: int, gamma: float | None) -> None:
    """The same in the full encoding."""
    found = prove(random_arc_problem(np.random.default_rng(seed), 20, "full"), gamma, "full")
    assert found.faults() == ()


@settings(max_examples=30)
@given(seed=SEEDS, gamma=GAMMAS)
def test_any_route_problem_is_exact(seed: int, gamma: float | None) -> None:
    """Random route problems, losses and stops that nobody serves among them."""
    found = prove(random_route_problem(np.random.default_rng(seed), 16), gamma)
    assert found.faults() == ()


@settings(max_examples=20)
@given(seed=SEEDS, route=st.booleans())
def test_selections_are_judged_at_once_as_one_by_one(seed: int, route: bool) -> None:
    """Counting bits finds the selections valid that the decoder finds valid, and no others."""
    rng = np.random.default_rng(seed)
    problem: Problem = random_route_problem(rng, 12) if route else random_arc_problem(rng, 14)
    n = problem.choices
    one_by_one = [
        not violations(problem, [i for i in range(n) if s >> i & 1]) for s in range(1 << n)
    ]
    assert valid_selections(problem).tolist() == one_by_one


@settings(max_examples=30)
@given(
    seed=SEEDS,
    gamma=st.sampled_from([None, 50.0, 0.01]),
    encoding=st.sampled_from(["full", "reduced"]),
)
def test_parts_find_what_the_whole_finds(
    seed: int, gamma: float | None, encoding: Encoding
) -> None:
    """Eliminating auxiliary bits gives every figure that looking at all states gives."""
    problem = random_arc_problem(np.random.default_rng(seed), 17, encoding)
    model = build_model(problem, gamma, encoding=encoding)
    parts, whole = eliminate(model), enumerate_model(model)
    for field in fields(Exactness):
        ours, theirs = getattr(parts, field.name), getattr(whole, field.name)
        if field.name != "minimum_selected":  # of several states that are equally low
            assert ours == pytest.approx(theirs, abs=1e-9), field.name


def test_parts_that_are_too_large_are_refused() -> None:
    """Four customers in any order: all auxiliary bits hang together, 44 of them."""
    places = ("d", "a", "b", "c", "e")
    arcs = tuple(CandidateArc("v", i, j, 0.1) for i in places for j in places if i != j)
    model = build_model(ArcProblem("d", places[1:], ("v",), arcs))
    assert not can_prove(model)
    with pytest.raises(ValueError, match="too many"):
        eliminate(model)


def an_arc_problem() -> Problem:
    """A published problem with four valid route sets."""
    instance = open_instance("arc20-avenue")
    return arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s)


def test_a_weight_that_is_too_small_fails() -> None:
    """With γ = 0.001 kWh the empty plan is cheapest: minimum and separation are both reported."""
    found = prove(an_arc_problem(), 0.001)
    assert found.equivalent
    assert not found.minimum_matches
    assert not found.holds
    assert len(found.faults()) == 2


def test_a_penalty_that_forgets_a_rule_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """A penalty that charges nothing for one arc is found out by the decoder."""

    def forgetful(problem: Problem, gamma: float | None, **_: object) -> QuboModel:
        model = build_model(problem, gamma)
        penalty = dimod.BinaryQuadraticModel(model.penalty)
        first = model.variables[0]
        penalty.set_linear(first, 0.0)
        for neighbour in list(penalty.adj[first]):
            penalty.set_quadratic(first, neighbour, 0.0)
        return replace(model, penalty=penalty)

    monkeypatch.setattr(proof_module, "build_model", forgetful)
    found = prove(an_arc_problem())
    assert not found.equivalent
    assert "unlike the decoder" in found.faults()[0]


def test_a_larger_weight_squashes_the_spread() -> None:
    """Valid states share the same range of kWh of a whole that grows with γ."""
    problem = an_arc_problem()
    bound, fifty = prove(problem), prove(problem, 50.0)
    assert bound.holds
    assert fifty.holds
    assert bound.gamma_kwh < 50.0
    assert 0 < fifty.found.spread < bound.found.spread < 1
    assert fifty.found.spread * 50.0 == pytest.approx(
        bound.found.spread * bound.gamma_kwh, rel=0.25
    )
