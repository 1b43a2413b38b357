from __future__ import annotations

import multiprocessing
import threading
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from dispatcher_daemon.forms.problem import Problem, RouteOption, RouteProblem
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.workers.executor import executor_solve
from dispatcher_daemon.solvers.workers.pool import GRACE_S, PoolJob

ENOUGH = threading.Event()

PROBLEM = RouteProblem(
    ("v", "w"),
    ("a",),
    (
        RouteOption("v", ("a",), 1.0),
        RouteOption("v", (), 0.0),
        RouteOption("w", ("a",), 0.8),
        RouteOption("w", (), 0.0),
    ),
)


@dataclass(frozen=True)
class Odd:
    """A solver that raises with seed 1, dawdles with seed 2 and talks nonsense with seed 3."""

    name: str = "odd"

    def warm_up(self) -> None:
        """Nothing."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See the class; with other seeds the reason holds the deadline and where it ran."""
        if seed == 1:
            raise ValueError("no such\nluck")
        if seed == 2:
            ENOUGH.wait(30)
        if seed == 3:
            return "42"  # type: ignore[return-value]
        return Outcome(self.name, "feasible", frozenset(), 0.0, reason=f"{deadline_s} {seed}")


@pytest.mark.long
@pytest.mark.process
def test_blocks_are_solved_in_parallel_processes() -> None:
    """A process pool's answers are those of solving in place, in the jobs' order."""
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        solve = executor_solve(executor, [ExactSolver()], workers=2)
        jobs = [PoolJob("exact", PROBLEM, 1), PoolJob("exact", PROBLEM.without_platooning(), 2)]
        outcomes = solve(jobs, 300.0)
    assert [o.status for o in outcomes] == ["optimal"] * 2
    assert [o.selected for o in outcomes] == [frozenset({1, 2})] * 2


@pytest.mark.slow
def test_faults_and_deadlines_become_outcomes() -> None:
    """Raising, dawdling, nonsense and unknown solvers are reported, in time; others answer."""
    with ThreadPoolExecutor(5) as executor:
        solve = executor_solve(executor, [Odd()], workers=5)
        jobs = [PoolJob("odd", PROBLEM, seed) for seed in (0, 1, 2, 3)] + [
            PoolJob("none", PROBLEM, 0)
        ]
        began = time.monotonic()
        try:
            good, raised, late, nonsense, unknown = solve(jobs, 0.5)
        finally:
            ENOUGH.set()
        assert time.monotonic() - began < 0.5 + GRACE_S + 9
    assert good.status == "feasible"
    assert (raised.status, raised.reason) == ("failed", "ValueError: no such luck")
    assert late.status == "timeout"
    assert (nonsense.status, nonsense.reason) == ("failed", "TypeError: answered with a str")
    assert unknown.status == "failed"


@pytest.mark.parametrize(("workers", "share_s"), [(1, 2.5), (2, 5.0), (4, 10.0)])
def test_jobs_that_queue_share_the_deadline(workers: int, share_s: float) -> None:
    """Four jobs get a quarter of the time each on one worker, half of it on two, all on four."""
    with ThreadPoolExecutor(workers) as executor:
        solve = executor_solve(executor, [Odd()], workers=workers)
        outcomes = solve([PoolJob("odd", PROBLEM, 5) for _ in range(4)], 10.0)
    assert [o.reason for o in outcomes] == [f"{share_s} 5"] * 4


def test_a_closed_executor_is_reported() -> None:
    """No exception reaches the caller when the executor takes no jobs any more."""
    executor: Executor = ThreadPoolExecutor(1)
    executor.shutdown()
    (outcome,) = executor_solve(executor, [Odd()])([PoolJob("odd", PROBLEM, 0)], 1.0)
    assert outcome.status == "failed"
    assert "shutdown" in (outcome.reason or "")
