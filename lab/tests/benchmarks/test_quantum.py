"""Parts of `slipstream_lab.benchmarks.quantum` that are quick enough to be tested whole."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.solvers.exact import ExactSolver
from slipstream_lab.benchmarks.quantum import __main__ as whole
from slipstream_lab.benchmarks.quantum import depth, large
from slipstream_lab.benchmarks.quantum.blocks import (
    CityPart,
    order_by_weight,
    part_of,
    ratio,
    sweep,
    without_last,
)


def fleet(seed: int, sizes: list[int]) -> tuple[RouteProblem, nx.Graph]:
    """Vehicles with options, savings among all of them, and the graph of who saves with whom."""
    rng = np.random.default_rng(seed)
    names = [f"v{k:02d}" for k in range(len(sizes))]
    options = [
        RouteOption(name, (), 1.0 + 0.05 * float(rng.random()))
        for name, size in zip(names, sizes, strict=True)
        for _ in range(size)
    ]
    savings = {
        (a, b): 0.04 * float(rng.random())
        for a, b in combinations(range(len(options)), 2)
        if options[a].vehicle != options[b].vehicle and rng.random() < 0.3
    }
    graph = nx.Graph()
    graph.add_nodes_from(names)
    for (a, b), saving in savings.items():
        one, two = options[a].vehicle, options[b].vehicle
        before = graph.edges[one, two]["weight"] if graph.has_edge(one, two) else 0.0
        graph.add_edge(one, two, weight=before + saving)
    return RouteProblem(tuple(names), (), tuple(options), savings), graph


def best(problem: RouteProblem) -> frozenset[int]:
    """The proven optimum."""
    outcome = ExactSolver().solve(problem, 20.0, 1)
    assert outcome.status == "optimal"
    assert outcome.selected is not None
    return outcome.selected


def test_parts_have_the_asked_number_of_variables_and_are_nested() -> None:
    """Exactly so many options, the base route of each vehicle first; single options are no use."""
    problem, graph = fleet(1, [3, 1, 4, 2, 3, 1, 5, 2])
    small, large_part = (part_of(problem, graph, n) for n in (7, 15))
    for part, n in ((small, 7), (large_part, 15)):
        assert part.problem.choices == n
        assert not {"v01", "v05"} & set(part.problem.vehicles)
        assert len(part.start) == len(part.problem.vehicles)
        assert set(part.graph) == set(part.problem.vehicles)
    assert (
        large_part.problem.vehicles[: len(small.problem.vehicles) - 1]
        == (small.problem.vehicles[:-1])
    )
    with pytest.raises(ValueError, match="only"):
        part_of(problem, graph, 99)


def test_vehicles_come_in_the_order_of_their_ties() -> None:
    """After the heaviest one, each next has the largest weight to those before it."""
    graph = nx.Graph()
    graph.add_weighted_edges_from([("a", "b", 5.0), ("b", "c", 1.0), ("a", "d", 3.0)])
    assert order_by_weight(graph) == ["a", "b", "d", "c"]


def test_a_problem_without_its_last_options_costs_the_same() -> None:
    """What is left has its costs and savings."""
    problem, _ = fleet(2, [2, 3])
    cut = without_last(problem, 1)
    assert cut.choices == 4
    for chosen in ({0, 2}, {1, 3}):
        assert cut.objective_kwh(chosen) == problem.objective_kwh(chosen)


@pytest.mark.parametrize("variables", [4, 8, 100])
def test_sweeps_never_get_worse_and_one_block_is_the_optimum(variables: int) -> None:
    """Exact blocks lie between base routes and optimum; a block of all is the optimum."""
    problem, graph = fleet(3, [3, 3, 4, 2, 3])
    part = CityPart(problem, graph)
    swept = sweep(part, variables, lambda block, _: best(block), 2, 10)
    start, optimum = (problem.objective_kwh(s) for s in (part.start, best(problem)))
    assert optimum - 1e-9 <= swept.objective_kwh <= start
    reached = ratio(start, optimum, swept.objective_kwh)
    assert reached is not None
    assert 0 < reached <= 1 + 1e-9
    if variables == 100:
        assert reached == pytest.approx(1.0)
    assert sweep(part, variables, lambda block, _: None, 2, 10).objective_kwh == start


def test_a_ratio_needs_a_gain() -> None:
    """1 at the optimum, 0 at the start, negative below it, nothing where nothing can be gained."""
    assert ratio(2.0, 1.0, 1.0) == 1.0
    assert ratio(2.0, 1.0, 2.0) == 0.0
    assert ratio(2.0, 1.0, 2.5) == -0.5
    assert ratio(1.0, 1.0, 1.0) is None


def test_one_circuit_stands_beside_sweeps_and_controls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every way has its ratio; a valid one lies at most at the optimum."""
    problem, graph = fleet(4, [3, 3, 3, 3])
    monkeypatch.setattr(large, "city_part", lambda *_: CityPart(problem, graph))
    plan = large.LargePlan(
        variants=("one-hot",), layers=1, shots=60, iterations=8, backend="aer", sweeps=False
    )
    block = large.measure(plan, 12)
    assert (block.variables, block.vehicles, block.proven) == (12, 4, True)
    exact, uniform, circuit, marginals = block.found
    assert exact.ratios[0] is not None
    # One option each by construction.
    assert circuit.p_feasible == uniform.p_feasible == marginals.p_feasible == 1.0
    assert circuit.qubits == 12
    for way in (circuit, uniform, marginals):
        assert all(value is not None and value <= 1 + 1e-9 for value in way.ratios)
        assert way.mean_ratio is not None
        assert way.ratios[0] is not None
        assert way.mean_ratio <= way.ratios[0]
    text = large.report([block], plan)
    assert "control: uniform options" in text
    assert "all proven" in text


@pytest.mark.long
def test_depths_of_both_targets_are_held_against_the_aims() -> None:
    """4p with CZ, 2p with native RZZ, and far below the dense circuit."""
    rows = depth.measure(1, [1])
    assert [(row.gate, row.worst_depth) for row in rows] == [("CZ", 4), ("RZZ", 2)]
    checks = depth.checks(rows)
    assert all(check.reached for check in checks)
    assert "75" in checks[1].what


def test_parts_run_in_processes_and_the_worst_status_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Output is shown and kept; one part that misses its aim fails the whole."""
    good, bad = ("-c", "print('fine')"), ("-c", "print('missed'); raise SystemExit(1)")
    parts = {"a": whole.BenchPart("A", bad, good), "b": whole.BenchPart("B", bad, bad)}
    monkeypatch.setattr(whole, "PARTS", parts)
    said: list[str] = []
    assert whole.run(["a", "b"], True, tmp_path, said.append) == {"a": 0, "b": 1}
    assert (tmp_path / "a.txt").read_text() == "fine\n"
    assert any("missed" in line for line in said)
