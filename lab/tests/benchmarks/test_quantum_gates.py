"""The comparison of circuits with and without entangling gates, and of warm starts."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import dimod
import numpy as np
import pytest

from dispatcher_daemon.forms import QuboModel
from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.solvers.quantum.ising import to_ising
from dispatcher_daemon.solvers.quantum.statevector.diagonal import cost_diagonal
from dispatcher_daemon.solvers.quantum.statevector.transverse import StateVector
from slipstream_lab.benchmarks.quantum import gates, warm_starts
from slipstream_lab.benchmarks.quantum.gates_report import interval, paired, sign_test, tables
from slipstream_lab.benchmarks.quantum.variants import VariantCase, case_of
from slipstream_lab.research.quantum.store import Store


@pytest.fixture
def case() -> VariantCase:
    """Two vehicles with two options each; meeting on their second ones is best."""
    costs = ((0, 1.0), (0, 1.1), (1, 1.0), (1, 1.15))
    options = tuple(RouteOption(f"v{k}", (f"s{k}",), cost) for k, cost in costs)
    problem = RouteProblem(("v0", "v1"), ("s0", "s1"), options, {(1, 3): 0.5})
    return case_of("two", problem)


def test_intervals_and_tests_are_exact() -> None:
    """Published values: Clopper and Pearson's of 0 of 10 and 5 of 10, and coins."""
    assert interval(0, 10) == (0.0, pytest.approx(0.3085, abs=1e-4))
    assert interval(5, 10) == (pytest.approx(0.1871, abs=1e-4), pytest.approx(0.8129, abs=1e-4))
    assert paired([True] * 5 + [False], [False] * 5 + [False]) == (5, 0, pytest.approx(2 / 32))
    assert paired([True, False], [True, False]) == (0, 0, 1.0)
    # Ten runs that differ in the same direction are one observation of one instance.
    names = ["a"] * 10 + ["b"]
    assert sign_test(names, [True] * 10 + [False], [False] * 10 + [True]) == (1, 1, 1.0)


def test_without_gates_samples_and_marginals_are_the_same_distribution(case: VariantCase) -> None:
    """The control of the control; the optimum of two vehicles is found, and so by random starts."""
    found = gates.train_and_sample(case, "one-hot", "product", seed=1)
    assert found["circuit"]["p_optimal"] == pytest.approx(found["marginals"]["p_optimal"])
    assert found["likeliest"] == (found["circuit"]["p_optimal"] > 0.5)
    assert found["circuit"]["raw"] / gates.SHOTS == pytest.approx(
        found["circuit"]["p_optimal"], abs=0.1
    )
    hit = gates.random_starts(case, "one-hot", seed=1)
    assert hit["hit"]
    assert hit["starts"] <= 256


def test_optimal_rows_read_choices_only(case: VariantCase) -> None:
    """The optimum is options 1 and 3; further bits are not looked at."""
    rows = np.array([[0, 1, 0, 1, 0], [0, 1, 0, 1, 1], [1, 0, 0, 1, 0]], dtype=np.int8)
    assert gates.optimal_rows(case, rows).tolist() == [True, True, False]


def test_an_interrupted_run_goes_on(
    case: VariantCase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is stored is not measured again; only whole pairs are shown."""
    monkeypatch.setattr(gates, "cases", lambda encoding, count: [case] if encoding else [])
    monkeypatch.setattr(gates, "STARTS", {("one-hot", "gates"): 1, ("one-hot", "product"): 1})
    run_one, limit = gates.run_one, 4
    made: list[tuple[str, int]] = []

    def counted(of: VariantCase, encoding: str, arm: str, seed: int) -> dict[str, Any]:
        if len(made) == limit:
            raise KeyboardInterrupt
        made.append((arm, seed))
        return run_one(of, encoding, arm, seed)

    monkeypatch.setattr(gates, "run_one", counted)
    path = tmp_path / "gates.jsonl"
    with Store(path, gates.stamp()) as store, pytest.raises(KeyboardInterrupt):
        gates.measure(store, ["one-hot"], 1, 2, lambda _: None)
    with Store(path, gates.stamp()) as store:
        assert len(gates.stored(store, "one-hot", 1, 2)) == 1
        limit = 6
        gates.measure(store, ["one-hot"], 1, 2, lambda _: None)
        runs = gates.stored(store, "one-hot", 1, 2)
    assert made == [(arm, seed) for seed in (1001, 2001) for arm in gates.ARMS["one-hot"]]
    lines = list(tables({"one-hot": runs}))
    assert any(
        "| one-hot | random starts, descended | 2 | 2 | 100.0 % (15.8-100.0)" in x for x in lines
    )


def linear_model(weights: list[float], coupling: float) -> QuboModel:
    """A QUBO of bits with one coupling between the first two."""
    names = [f"x{i}" for i in range(len(weights))]
    bqm = dimod.BinaryQuadraticModel(dict(zip(names, weights, strict=True)), {}, 0.0, "BINARY")
    bqm.add_quadratic("x0", "x1", coupling)

    class Model:
        """As far as a relaxation looks."""

        total = bqm
        variables = tuple(names)

    return Model()  # type: ignore[return-value]


def test_the_relaxation_is_exact_without_couplings_and_between_bits_with_them() -> None:
    """Separable: each bit by its sign. Two bits of which one is to be set: both a half."""
    assert warm_starts.relaxed(linear_model([1.0, -2.0, 3.0], 0.0)) == pytest.approx([0, 1, 0])
    assert warm_starts.relaxed(linear_model([-1.0, -1.0], 2.0)) == pytest.approx([0.5, 0.5])


def test_a_warm_start_at_a_half_is_the_usual_circuit(case: VariantCase) -> None:
    """Against the other simulator, two layers."""
    diagonal = cost_diagonal(to_ising(case.model.total, case.model.variables).normalised())
    usual, warm = StateVector(diagonal, threads=1), warm_starts.WarmState(diagonal, np.full(4, 0.5))
    for state in (usual, warm):
        state.evolve([(0.3, 0.4), (0.2, 0.7)])
    assert warm.probabilities(0, 16) == pytest.approx(usual.probabilities(0, 16), abs=1e-6)


def test_a_warm_start_is_the_mixers_ground_state(case: VariantCase) -> None:
    """Its bits have the given probabilities, and mixing alone leaves them."""
    diagonal = cost_diagonal(to_ising(case.model.total, case.model.variables).normalised())
    values = np.array([0.25, 0.75, 0.4, 0.5])
    state = warm_starts.WarmState(diagonal, values)
    for schedule in ([], [(0.7, 0.0)], [(0.7, 0.0), (1.1, 0.0)]):
        state.evolve(schedule)
        assert state.marginals().probabilities == pytest.approx(values)
    state.evolve([(0.7, 0.9)])
    assert state.marginals().probabilities != pytest.approx(values, abs=1e-3)


def test_seeds_are_repaired_and_the_first_optimum_is_timed(case: VariantCase) -> None:
    """The optimum itself is a hit in the first batch; what leads nowhere gives up in time."""
    best = np.repeat(np.array([[0, 1, 0, 1]], dtype=np.int8), 64, axis=0)
    found = warm_starts.seeds_of(case, lambda number: best, 1, time.process_time())
    assert (found["raw"], found["descended"], found["repaired"]) == (1.0, 1.0, 1.0)
    assert 0 < found["first_s"] < 5
    for arm, layers in (("random", 0), ("relaxation", 0), ("cold", 1), ("warm", 1)):
        run = warm_starts.run_one(case, arm, layers, seed=1)
        assert 0 < run["circuit"]["repaired"] <= 1
        assert run["circuit"]["first_s"] >= run.get("train_s", 0.0)
    assert len(list(warm_starts.table([("warm", 1, [run])]))) == 4
