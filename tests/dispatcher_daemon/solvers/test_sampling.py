from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import ArcProblem, RouteOption, RouteProblem
from dispatcher_daemon.solvers.sampling import (
    SampledBits,
    answer,
    descend,
    one_option_each,
    solve_by_sampling,
    stages,
)

Demo = Callable[..., ArcProblem]
Routes = Callable[..., RouteProblem]


@pytest.mark.slow
@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_stages_are_what_each_sample_becomes(random_routes: Routes, seed: int) -> None:
    """Each histogram counts the shots whose own bits are valid at that stage, by objective."""
    problem = random_routes(seed, [3, 2, 3], 2)
    model = build_model(problem)
    rng = np.random.default_rng(seed)
    bits = (rng.random((12, 8)) < 0.35).astype(np.int8)
    counts = rng.integers(1, 5, size=12)
    samples, best = stages(model, bits, counts, 1)
    after = (bits, descend(model, bits, 1), descend(model, one_option_each(model, bits), 1))
    histograms = (samples.raw, samples.descended, samples.repaired)
    for rows, histogram, winner in zip(after, histograms, best, strict=True):
        expected: dict[float, int] = {}
        for row, count in zip(rows, counts, strict=True):
            selected = frozenset(np.flatnonzero(row).tolist())
            if not violations(problem, selected):
                value = round(problem.objective_kwh(selected), 9)
                expected[value] = expected.get(value, 0) + int(count)
        assert dict(histogram) == expected
        assert (winner is None) == (not expected)
        if winner is not None:
            assert round(winner[0], 9) == min(expected)
            assert winner[0] == problem.objective_kwh(winner[1])


def test_descent_alone_is_told_apart_from_repair(random_routes: Routes) -> None:
    """Where repair gets further than descent, each has its own histogram."""
    model = build_model(random_routes(3, [4, 4, 4], 3))
    bits = np.random.default_rng(2).integers(0, 2, (400, 12), dtype=np.int8)
    samples, _ = stages(model, bits, np.ones(400, dtype=np.int64), 1)
    assert samples.descended != samples.repaired
    shares = [samples.share(t) for t in (samples.raw, samples.descended, samples.repaired)]
    assert 0 <= shares[0] < min(shares[1:])


def test_arc_samples_get_better_from_stage_to_stage(demo_arcs: Demo) -> None:
    """More is valid after descent than before, and all after the repair; none falls out again."""
    model = build_model(demo_arcs(avenue_east=1))
    bits = np.random.default_rng(1).integers(0, 2, (300, 25), dtype=np.int8)
    samples, _ = stages(model, bits, np.ones(300, dtype=np.int64), 1)
    assert samples.share(samples.raw) < samples.share(samples.descended) < 1.0
    assert samples.share(samples.repaired) == 1.0


def test_an_optimal_share_is_part_of_the_feasible_one(random_routes: Routes) -> None:
    """Only shots with the optimum count for it; no sample lies below it."""
    problem = random_routes(3, [3, 3, 3], 2)
    optimum = solve_milp(problem, 10.0).objective_kwh
    assert optimum is not None
    model = build_model(problem)
    bits = np.random.default_rng(2).integers(0, 2, (500, 9), dtype=np.int8)
    samples, _ = stages(model, bits, np.ones(500, dtype=np.int64), 1)
    assert 0 < samples.share(samples.repaired, optimum) < samples.share(samples.repaired)
    assert min(value for value, _ in samples.repaired) >= optimum - 1e-9
    assert samples.share(samples.repaired, optimum - 1e-6) == 0.0


def test_a_raw_answer_is_preferred_to_an_equal_one_after_repair(random_routes: Routes) -> None:
    """What was sampled as it is needs no help and says so."""
    problem = random_routes(3, [3, 3], 1)
    exact = solve_milp(problem, 10.0).selected
    assert exact is not None
    bits = np.zeros((2, 6), dtype=np.int8)
    bits[0, list(exact)] = 1
    outcome = answer("x", build_model(problem), bits, np.array([1, 1]), 1, time.perf_counter())
    assert outcome.selected == exact
    assert not outcome.repaired


def test_the_frame_says_why_there_is_no_answer(random_routes: Routes) -> None:
    """Nothing to choose, no time to draw, nothing valid drawn: each in words."""

    def solve(problem: RouteProblem, drawn: SampledBits | None) -> tuple[str, str | None]:
        outcome = solve_by_sampling("x", problem, None, "reduced", 1, lambda _: drawn)
        assert outcome.selected is None
        return outcome.status, outcome.reason

    empty = RouteProblem((), (), ())
    assert solve(empty, None) == ("failed", "the problem has nothing to choose")
    problem = random_routes(1, [2, 2], 1)
    assert solve(problem, None) == ("timeout", "no time left for a search")
    stuck = RouteProblem(
        ("v", "w"), ("a",), (RouteOption("v", ("a",), 1.0), RouteOption("w", ("a",), 1.0))
    )
    nothing = SampledBits(np.zeros((1, 2), dtype=np.int8), np.array([1]))
    assert solve(stuck, nothing) == ("failed", "no sample led to a valid route set")
