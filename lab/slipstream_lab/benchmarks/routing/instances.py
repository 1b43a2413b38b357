"""The named instances: how fast and how well each solver answers them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Final

from dispatcher_daemon.forms import Problem, build_model, violations
from dispatcher_daemon.planning.arc_form import arc_problem_of
from dispatcher_daemon.solvers import AnnealingSolver, ExactSolver, Solver, TabuSolver
from slipstream_lab.benchmarks.routing.figures import InstanceRow, SolverAnswer
from slipstream_lab.research.instances.registry import instance_names, open_instance

VARIABLES: Final = 25
DEADLINE_S: Final = 10.0


def measure_instances(repeats: int) -> Iterator[InstanceRow]:
    """All instances of exactly 25 variables that are published by name."""
    solvers: list[Solver] = [ExactSolver(), TabuSolver(), AnnealingSolver()]
    for solver in solvers:
        solver.warm_up()
    for name in instance_names():
        instance = open_instance(name)
        problem = arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s)
        variables = len(build_model(problem).variables)
        if variables != VARIABLES or instance.optimum is None:
            continue
        answers = {solver.name: answer(solver, problem, repeats) for solver in solvers}
        yield InstanceRow(name, variables, instance.optimum.objective_kwh, answers)


def answer(solver: Solver, problem: Problem, repeats: int) -> SolverAnswer:
    """What a solver answers with seeds 1, 2, ...; its objective is evaluated on the problem."""
    times, found, proven = [], [], []
    for seed in range(1, repeats + 1):
        began = time.perf_counter()
        outcome = solver.solve(problem, DEADLINE_S, seed)
        times.append(time.perf_counter() - began)
        found.append(_objective_kwh(problem, outcome.selected))
        proven.append(outcome.status == "optimal")
    valid: Sequence[float] = [value for value in found if value is not None]
    worst = max(valid) if len(valid) == len(found) else None
    return SolverAnswer(tuple(times), worst, all(proven))


def _objective_kwh(problem: Problem, selected: frozenset[int] | None) -> float | None:
    if selected is None or violations(problem, selected):
        return None
    return problem.objective_kwh(selected)
