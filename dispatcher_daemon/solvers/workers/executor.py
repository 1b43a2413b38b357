"""Solvers on any `concurrent.futures.Executor`: threads, processes or a cluster."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import TypeVar

from dispatcher_daemon.solvers.protocol import Outcome, Solver
from dispatcher_daemon.solvers.workers.pool import PoolJob, Solve, outcome_of, run_job

T = TypeVar("T")
R = TypeVar("R")


class TimedExecutor(Executor):
    """An executor that is told how long a call may take, as it may have to run it once more."""

    def submit_within(
        self, within_s: float, limit_s: float, function: Callable[[T, float], R], argument: T
    ) -> Future[R]:
        """Run a picklable call ``function(argument, seconds)``.

        Args:
            within_s: by when the answer is needed, waiting for a worker included.
            limit_s: for the call alone; it may be told fewer seconds.
        """
        raise NotImplementedError


def executor_solve(executor: Executor, solvers: Sequence[Solver], *, workers: int = 1) -> Solve:
    """A `Solve` that runs jobs on an executor; faults and deadlines become Outcomes.

    Executors cannot stop a job: one that overruns keeps its worker until it is done. Where solvers
    may hang, `SolverPool` is the one to use. A process pool that broke stays broken; then all jobs
    fail with that reason.

    Args:
        executor: not closed here. Processes and clusters need picklable solvers.
        solvers: of different names.
        workers: how many jobs the executor runs at once; jobs that have to queue share the
            deadline.
    """
    by_name = {solver.name: solver for solver in solvers}

    def solve(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        began = time.monotonic()
        share_s = deadline_s / max(1, math.ceil(len(jobs) / workers))
        futures = [_submit(executor, by_name, job, share_s) for job in jobs]
        late = "no answer within the deadline"
        return [
            outcome_of(job, future, began, deadline_s, late)
            for job, future in zip(jobs, futures, strict=True)
        ]

    return solve


def _submit(
    executor: Executor, solvers: dict[str, Solver], job: PoolJob, deadline_s: float
) -> Future[Outcome] | Exception:
    try:
        return executor.submit(run_job, solvers[job.solver], job.problem, deadline_s, job.seed)
    except Exception as error:
        return error
