from __future__ import annotations

import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import ArcProblem, Problem, RouteOption, RouteProblem
from dispatcher_daemon.planning.arc_form.arcs import arc_problem_of
from dispatcher_daemon.settings import BUILT_IN_SOLVERS, DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.heuristics import AnnealingSolver, TabuSolver
from dispatcher_daemon.solvers.insertion import InsertionSolver, cheapest_options
from dispatcher_daemon.solvers.protocol import Solver
from dispatcher_daemon.solvers.registry import make_solver
from dispatcher_daemon.solvers.sampling import one_option_each
from slipstream_lab.research.instances import open_instance

Demo = Callable[..., ArcProblem]
Routes = Callable[..., RouteProblem]

NAMES = tuple(name for name in BUILT_IN_SOLVERS if name != "cplex")


def published(name: str) -> ArcProblem:
    """The arc form of a published instance."""
    instance = open_instance(name)
    return arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s)


def blocks(seed: int, vehicles: int, options: int) -> RouteProblem:
    """Options that cost some kWh and save some Wh together, as in a dispatcher's block."""
    rng = np.random.default_rng(seed)
    every = [
        RouteOption(f"v{k}", (f"s{k}",), 2.0 + k / 10 + 0.02 * float(rng.random()))
        for k in range(vehicles)
        for _ in range(options)
    ]
    savings = {
        (a, b): 0.03 * float(rng.random())
        for a in range(len(every))
        for b in range(a + 1, len(every))
        if every[a].vehicle != every[b].vehicle and rng.random() < 0.2
    }
    fleet = tuple(f"v{k}" for k in range(vehicles))
    return RouteProblem(fleet, tuple(f"s{k}" for k in range(vehicles)), tuple(every), savings)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", ["arc", "route"])
def test_every_solver_takes_both_forms(name: str, kind: str) -> None:
    """The answer is valid, no better than the optimum, and says how it came about."""
    problem: Problem = published("arc14-avenue") if kind == "arc" else blocks(1, 4, 3)
    solver = make_solver(name, DispatcherSettings())
    solver.warm_up()
    outcome = solver.solve(problem, 10.0, seed=3)
    assert outcome.solver == solver.name == name
    assert outcome.status == ("optimal" if name == "exact" else "feasible")
    assert outcome.selected is not None
    assert violations(problem, outcome.selected) == ()
    optimum = solve_milp(problem, 10.0).objective_kwh
    assert optimum is not None
    assert problem.objective_kwh(outcome.selected) >= optimum - 1e-9
    assert outcome.wall_s > 0
    assert outcome.reason is None


@pytest.mark.parametrize("solver", [TabuSolver(), AnnealingSolver()])
@pytest.mark.parametrize("name", ["arc25-01-avenue", "arc25-11-motorway", None])
def test_heuristics_find_the_optimum_of_25_variables(solver: Solver, name: str | None) -> None:
    """On instances of the paper's size tabu search and annealing get there, with time to spare."""
    problem: Problem = blocks(2, 5, 5) if name is None else published(name)
    outcome = solver.solve(problem, 10.0, seed=1)
    assert outcome.selected is not None
    exact = solve_milp(problem, 10.0)
    assert problem.objective_kwh(outcome.selected) == pytest.approx(exact.objective_kwh, abs=1e-9)
    samples = outcome.samples
    assert samples is not None
    assert samples.qubits is None
    assert 0 < samples.share(samples.raw) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("solver", [TabuSolver(), AnnealingSolver()])
def test_same_seed_same_answer_and_samples(solver: Solver) -> None:
    """Two runs with one seed agree in everything but time, and another seed samples anew."""
    problem = blocks(3, 8, 5)
    one, two, other = (solver.solve(problem, 20.0, seed) for seed in (7, 7, 8))
    assert (one.selected, one.samples) == (two.selected, two.samples)
    assert one.samples != other.samples


@pytest.mark.long
@pytest.mark.parametrize("solver", [TabuSolver(), AnnealingSolver(), ExactSolver()])
def test_the_deadline_is_kept(solver: Solver) -> None:
    """A problem of hundreds of variables ends in time, whatever has been found by then."""
    problem = blocks(4, 50, 8)
    began = time.perf_counter()
    outcome = solver.solve(problem, 2.0, seed=1)
    # Four seconds for a slow machine.
    assert time.perf_counter() - began < 6
    assert outcome.status in {"feasible", "optimal", "timeout"}


def test_infeasible_problems_are_said_to_be_so() -> None:
    """Exact proves it; samplers only say that they found nothing."""
    stuck = RouteProblem(
        ("v", "w"), ("a",), (RouteOption("v", ("a",), 1.0), RouteOption("w", ("a",), 1.0))
    )
    assert ExactSolver().solve(stuck, 5.0, 1).status == "infeasible"
    for solver in (TabuSolver(), AnnealingSolver(), InsertionSolver()):
        outcome = solver.solve(stuck, 5.0, 1)
        assert (outcome.status, outcome.selected) == ("failed", None)
        assert outcome.reason


def test_a_problem_without_choices_is_no_crash() -> None:
    """No vehicle, no stop, nothing to do: samplers say so."""
    for solver in (TabuSolver(), AnnealingSolver()):
        assert "nothing to choose" in (solver.solve(RouteProblem((), (), ()), 5.0, 1).reason or "")


@pytest.mark.slow
@settings(max_examples=40)
@given(seed=st.integers(0, 10**6))
def test_repair_leaves_one_option_each_and_the_best_of_those_selected(
    random_routes: Routes, seed: int
) -> None:
    """After repair every vehicle has one option, one of its selected ones where it had any."""
    problem = random_routes(seed, [3, 2, 4], 2)
    model = build_model(problem)
    rng = np.random.default_rng(seed)
    before = rng.integers(0, 2, size=(30, 9), dtype=np.int8)
    after = one_option_each(model, before)
    for options in problem.options_of.values():
        group = list(options)
        assert np.all(after[:, group].sum(axis=1) == 1)
        had = before[:, group].any(axis=1)
        assert np.all((after[:, group] <= before[:, group]).all(axis=1) | ~had)
    # The last vehicle's option is the best one, given what the others have by then.
    names, group = list(model.variables), list(problem.options_of["v2"])
    for row, start in zip(after, before, strict=True):
        allowed = [i for i in group if start[i]] or group
        energies = []
        for i in allowed:
            trial = row.copy()
            trial[group] = 0
            trial[i] = 1
            energies.append(model.total.energy(dict(zip(names, trial, strict=True))))
        assert model.total.energy(dict(zip(names, row, strict=True))) <= min(energies) + 1e-9


def brute_force(problem: RouteProblem) -> bool:
    """Whether some choice of one option each serves every stop once."""
    return any(not violations(problem, set(c)) for c in product(*problem.options_of.values()))


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6))
def test_cheapest_options_are_valid_or_none(random_routes: Routes, seed: int) -> None:
    """The simple plan keeps the rules; where there is no valid plan, it finds none."""
    problem = random_routes(seed, [2, 3, 2], 3)
    selected = cheapest_options(problem)
    if selected is None:
        return
    assert violations(problem, selected) == ()
    assert brute_force(problem)


def test_cheapest_options_leave_no_stop_behind() -> None:
    """The cheap option that nobody could make up for is not taken."""
    problem = RouteProblem(
        ("v", "w"),
        ("a",),
        (
            RouteOption("v", (), 0.1),
            RouteOption("v", ("a",), 1.0),
            RouteOption("w", (), 0.1),
            RouteOption("w", (), 0.2),
        ),
    )
    assert cheapest_options(problem) == frozenset({1, 2})


def test_cplex_agrees_with_highs() -> None:
    """The same model file, another solver: equal optima of both forms, infeasible ones too."""
    pytest.importorskip("cplex", reason="CPLEX is not installed (extra cplex)")
    solver = make_solver("cplex", DispatcherSettings())
    solver.warm_up()
    problems: list[Problem] = [published(f"arc14-{kind}") for kind in ("avenue", "bridges")]
    problems += [published("arc25-11-motorway"), blocks(1, 5, 5)]
    for problem in problems:
        outcome = solver.solve(problem, 10.0, 1)
        assert outcome.status == "optimal"
        assert outcome.selected is not None
        assert violations(problem, outcome.selected) == ()
        exact = solve_milp(problem, 10.0)
        assert problem.objective_kwh(outcome.selected) == pytest.approx(
            exact.objective_kwh, abs=1e-8
        )
    stuck = RouteProblem(
        ("v", "w"), ("a",), (RouteOption("v", ("a",), 1.0), RouteOption("w", ("a",), 1.0))
    )
    assert solver.solve(stuck, 5.0, 1).status == "infeasible"


def test_cplex_is_silent(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Nothing of CPLEX's log reaches the terminal."""
    pytest.importorskip("cplex", reason="CPLEX is not installed (extra cplex)")
    make_solver("cplex", DispatcherSettings()).solve(published("arc14-avenue"), 10.0, 1)
    assert capfd.readouterr() == ("", "")
