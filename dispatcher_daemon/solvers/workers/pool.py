"""Solvers in worker processes under hard deadlines.

One worker a solver by default, kept warm. A worker that hangs is killed and replaced,
one that dies is replaced, one that raises goes on; in each case the caller gets an Outcome
with the reason.
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, TimeoutError, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, Self

from dispatcher_daemon.solvers.protocol import Outcome, Solver
from dispatcher_daemon.solvers.workers.processes import Processes
from slipstream.service.tracing import traced

if TYPE_CHECKING:
    from dispatcher_daemon.forms import Problem

log = logging.getLogger(__name__)

_POLL_S = 0.2
GRACE_S = 0.5
"""Time after its deadline for which an answer is still awaited, s."""
RESERVE = 0.2
"""Share of a cycle's deadline reserved for decoding, verification, storage and publication."""


@dataclass(frozen=True)
class PoolJob:
    """One problem for one solver (by name)."""

    solver: str
    problem: Problem
    seed: int


class Solve(Protocol):
    """Solves jobs within the deadline; outcomes in the order of the jobs."""

    def __call__(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """Does not raise for a solver's fault: its Outcome has no answer, and the reason."""
        ...


def solving_s(deadline_s: float) -> float:
    """Deadline of solvers whose cycle has this one: they, and the wait for those that hang, end
    before the cycle's reserve, unless that left them less than half.
    """
    return max(0.5 * deadline_s, (1 - RESERVE) * deadline_s - GRACE_S)


def _warm_up(solver: Solver) -> int:
    solver.warm_up()
    return os.getpid()


def run_job(solver: Solver, problem: Problem, deadline_s: float, seed: int) -> Outcome:
    """Run one job in a worker."""
    return solver.solve(problem, deadline_s, seed)


class _Workers(Processes):
    """One solver and the processes that run it."""

    def __init__(self, solver: Solver, spawner: ThreadPoolExecutor, size: int) -> None:
        super().__init__(
            size, spawner, f"workers of solver {solver.name}", modules=(type(solver).__module__,)
        )
        self.solver = solver

    def warm_up(self) -> list[Future[int]]:
        """One call for each process; one that starts late may miss its call and imports later."""
        return [self.schedule(_warm_up, (self.solver,)) for _ in range(self.size)]

    def submit(self, problem: Problem, deadline_s: float, seed: int) -> Future[Outcome]:
        job = (self.solver, problem, deadline_s, seed)
        return self.schedule(run_job, job, timeout_s=deadline_s + GRACE_S)


class SolverPool:
    """Worker processes of several solvers; a context manager, and a `Solve`.

    Args:
        solvers: solvers of different names.
        workers: processes of each solver, so that jobs of one solver run in parallel; by name,
            one for those not named, or one number for all.
    """

    def __init__(self, solvers: Sequence[Solver], workers: int | Mapping[str, int] = 1) -> None:
        by_name = workers if isinstance(workers, Mapping) else {s.name: workers for s in solvers}
        self._spawner = ThreadPoolExecutor(1, thread_name_prefix="solver-pool")
        self._lock = threading.Lock()
        self._closed = False
        self._workers = {
            solver.name: _Workers(solver, self._spawner, by_name.get(solver.name, 1))
            for solver in solvers
        }

    def warm_up(
        self, timeout_s: float = 60.0, stopping: threading.Event | None = None
    ) -> dict[str, str]:
        """Start all workers and import what they need.

        Args:
            timeout_s: how long they have.
            stopping: ends the wait when it is set.

        Returns:
            Reason by name of each solver that is not warm after the timeout; empty if all are.
        """
        ends = time.monotonic() + timeout_s
        futures = [(name, f) for name, w in self._workers.items() for f in w.warm_up()]
        waiting = {future for _, future in futures}
        while waiting and (left := ends - time.monotonic()) > 0:
            if stopping is not None and stopping.is_set():
                break
            waiting = wait(waiting, timeout=min(left, _POLL_S)).not_done
        faults: dict[str, str] = {}
        for name, future in futures:
            try:
                future.result(timeout=0.0)
            except (Exception, CancelledError) as error:
                future.cancel()
                faults[name] = error_line(error)
        return faults

    @traced("solve")
    def __call__(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """Run the jobs in parallel, as many of one solver at once as it has workers.

        Jobs of one solver that have to queue share the deadline.
        """
        began = time.monotonic()
        count = Counter(job.solver for job in jobs)
        futures = [self._submit(job, count[job.solver], deadline_s) for job in jobs]
        late = f"no answer within {deadline_s:g} s; worker replaced"
        return [
            outcome_of(job, future, began, deadline_s, late)
            for job, future in zip(jobs, futures, strict=True)
        ]

    def _submit(self, job: PoolJob, count: int, deadline_s: float) -> Future[Outcome] | Exception:
        with self._lock:
            if self._closed:
                return RuntimeError("the pool is closed")
            try:
                workers = self._workers[job.solver]
                share_s = deadline_s / math.ceil(count / workers.size)
                return workers.submit(job.problem, share_s, job.seed)
            except Exception as error:
                return error

    def fault(self) -> str | None:
        """Why no solver works, in words; None: one does, or none has been asked."""
        found = {name: workers.fault for name, workers in self._workers.items()}
        if not found or None in found.values():
            return None
        return "; ".join(f"{name}: {why}" for name, why in found.items())

    def ask_again(self, after_s: float) -> None:
        """See `Processes`."""
        with self._lock:
            for workers in () if self._closed else self._workers.values():
                workers.ask_again(after_s)

    def close(self) -> None:
        """Stop all workers at once; waiting callers get no answer."""
        with self._lock:
            self._closed = True
            for worker in self._workers.values():
                worker.stop()
        self._spawner.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def outcome_of(
    job: PoolJob, future: Future[Outcome] | Exception, began: float, deadline_s: float, late: str
) -> Outcome:
    """A job's outcome, awaited until a little after the deadline; faults become outcomes too.

    Args:
        future: or why there is none.
        began: monotonic time at which the deadline begins, s.
        late: reason where there is no answer in time.
    """
    try:
        if isinstance(future, Exception):
            raise future
        left_s = deadline_s + GRACE_S - (time.monotonic() - began)
        outcome = future.result(timeout=max(0.0, left_s))
        if not isinstance(outcome, Outcome):
            raise TypeError(f"answered with a {type(outcome).__name__}")
        return outcome
    except (TimeoutError, CancelledError):
        # Cancelling kills a worker process that runs the job; another one replaces it.
        if isinstance(future, Future):
            future.cancel()
        return Outcome(job.solver, "timeout", None, time.monotonic() - began, reason=late)
    except Exception as error:
        log.warning("solver %s failed: %s", job.solver, error_line(error))
        wall_s = time.monotonic() - began
        return Outcome(job.solver, "failed", None, wall_s, reason=error_line(error))


def error_line(error: BaseException) -> str:
    """Class and message of an error, in one line of at most some 200 characters."""
    text = " ".join(str(error).split())[:200]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def solve_in_process(solvers: Sequence[Solver]) -> Solve:
    """A `Solve` without worker processes and hard deadlines, for tools and tests."""
    by_name = {solver.name: solver for solver in solvers}

    def solve(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        outcomes = []
        for job in jobs:
            began = time.monotonic()
            try:
                outcome = by_name[job.solver].solve(job.problem, deadline_s, job.seed)
            except Exception as error:
                wall_s = time.monotonic() - began
                outcome = Outcome(job.solver, "failed", None, wall_s, reason=error_line(error))
            outcomes.append(outcome)
        return outcomes

    return solve
