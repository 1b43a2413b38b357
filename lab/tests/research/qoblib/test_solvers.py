"""Each solver of the referee on a small instance of our own."""

from __future__ import annotations

from pathlib import Path

import pytest

from dispatcher_daemon.settings import LcQaoaSettings
from lab.tests.research.qoblib.instances import OPTIMUM, library
from slipstream_lab.research.qoblib.solvers import (
    SOLVERS,
    TIMED_BY_CIRCUIT,
    SolverName,
    Task,
    opened,
    run_task,
)

TINY = LcQaoaSettings(layers=1, iterations=5, shots=64)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The instance's file."""
    return library(tmp_path_factory.mktemp("library"))


@pytest.mark.parametrize(
    "solver", [pytest.param(s, marks=pytest.mark.long if s == "pyvrp" else ()) for s in SOLVERS]
)
def test_every_solver_finds_the_optimum_of_nine_routes(path: Path, solver: SolverName) -> None:
    """With the time of a tiny circuit; what it says of its samples fits together.

    The routing search ended 9 % above it under the penalties for vehicles with room.
    """
    cpu_s = 0.05 if solver in TIMED_BY_CIRCUIT else None
    record = run_task(Task(solver, path, 1, TINY, 30.0, cpu_s))
    assert (record["cost"], record["reason"]) == (OPTIMUM, None)
    assert sorted(n for route in record["routes"] for n in route) == list(range(1, 13))
    assert record["cpu_s"] > 0
    assert (record["model_s"] == 0) == (solver == "pyvrp")
    assert record["bound"] == (OPTIMUM if solver == "exact" else None)
    if solver not in ("exact", "pyvrp"):
        assert 1 <= record["at_best"] <= record["valid"] <= record["samples"]
        assert record["missed"] == 0


@pytest.mark.parametrize("solver", ["circuit", "exact"])
def test_same_seed_same_answer(path: Path, solver: SolverName) -> None:
    """But for times."""
    tasks = [Task(solver, path, seed, TINY, 30.0) for seed in (3, 3)]
    first, second = (
        {k: v for k, v in run_task(task).items() if not k.endswith("_s")} for task in tasks
    )
    assert first == second


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["uniform", "marginals"])
def test_a_control_ends_with_its_processor_time(path: Path, solver: SolverName) -> None:
    """Twice the time, about twice the samples; training is in it."""
    opened(path)
    short, long = (run_task(Task(solver, path, 0, TINY, 60.0, cpu_s)) for cpu_s in (0.2, 0.8))
    assert short["cpu_s"] - short["model_s"] == pytest.approx(0.2, abs=0.15)
    assert long["cpu_s"] - long["model_s"] == pytest.approx(0.8, abs=0.15)
    assert long["samples"] > 1.5 * short["samples"]


def test_the_limit_ends_a_run_that_has_no_other_end(path: Path) -> None:
    """Annealing with any amount of processor time."""
    record = run_task(Task("annealing", path, 0, TINY, 1.0, 1e9))
    assert record["wall_s"] < 30
    assert record["cost"] == OPTIMUM
