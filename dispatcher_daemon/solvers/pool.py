"""Solvers in worker processes under hard deadlines.

One worker a solver unless told otherwise, kept warm. A worker that hangs is killed and replaced,
one that dies is replaced, one that raises goes on; in each case the caller gets an Outcome that
says so.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, TimeoutError, wait
from dataclasses import dataclass
from multiprocessing import connection
from typing import Any, Literal, Protocol, Self

import pebble

from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.base import Outcome, Solver
from slipstream.service import die_with_parent

log = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.2
GRACE_S = 0.5
"""How long after its deadline an answer is still waited for."""


@dataclass(frozen=True)
class Job:
    """One problem for one solver (by name)."""

    solver: str
    problem: Problem
    seed: int


class Solve(Protocol):
    """What a dispatch cycle needs: answers to jobs, in their order, within the deadline."""

    def __call__(self, jobs: Sequence[Job], deadline_s: float) -> list[Outcome]:
        """Never raises for a solver's fault; an Outcome without an answer stands for it."""
        ...


def start_worker(parent: int) -> None:
    """Tie the worker's life to its parent's and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The kernel's signal holds even while compiled code keeps the interpreter lock. It also fires
    # when the creating thread ends: SolverPool makes workers in threads that live as long as it.
    die_with_parent(parent)
    guardian = multiprocessing.parent_process()
    if guardian is not None:
        sentinel = guardian.sentinel

        def follow() -> None:
            connection.wait([sentinel])
            os._exit(1)

        threading.Thread(target=follow, name="parent-watch", daemon=True).start()


def _warm_up(solver: Solver) -> int:
    solver.warm_up()
    return os.getpid()


def run_job(solver: Solver, problem: Problem, deadline_s: float, seed: int) -> Outcome:
    """What a worker does for a job."""
    return solver.solve(problem, deadline_s, seed)


class _Workers:
    """One solver and the pool of processes that run it."""

    def __init__(self, solver: Solver, keeper: ThreadPoolExecutor, size: int) -> None:
        self.solver = solver
        self.size = size
        self._keeper = keeper
        self._pool: Any = None
        self._pending: set[Future[Any]] = set()

    def _living_pool(self) -> Any:
        """The pool, made anew if it broke (a worker that dies while idle breaks it)."""
        if self._pool is not None and not self._pool.active:
            log.warning("workers of solver %s broke; starting others", self.solver.name)
            self.stop()
        if self._pool is None:
            pool = pebble.ProcessPool(
                max_workers=self.size,
                context=multiprocessing.get_context("spawn"),
                initializer=start_worker,
                initargs=(os.getpid(),),
            )
            # Asking whether it is active starts it, in the thread that asks.
            self._keeper.submit(lambda: pool.active).result()
            self._pool = pool
        return self._pool

    def warm_up(self) -> list[Future[int]]:
        """One call a process; one that comes late may find its call taken, and imports later."""
        pool = self._living_pool()
        return [self._note(pool.schedule(_warm_up, args=(self.solver,))) for _ in range(self.size)]

    def submit(self, problem: Problem, deadline_s: float, seed: int) -> Future[Outcome]:
        return self._note(
            self._living_pool().schedule(
                run_job, args=(self.solver, problem, deadline_s, seed), timeout=deadline_s + GRACE_S
            )
        )

    def _note(self, future: Future[Any]) -> Future[Any]:
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        return future

    def stop(self) -> None:
        # A stopped pool leaves its futures open; whoever waits for one must hear of it.
        for future in tuple(self._pending):
            future.cancel()
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = None


class SolverPool:
    """Worker processes of several solvers; a context manager, and a `Solve`.

    Args:
        solvers: solvers of different names.
        workers: processes of each solver, so that jobs of one solver run side by side; by name,
            one for those not named, or one number for all.

    Raises:
        ValueError: two solvers with one name, or less than one worker.
    """

    def __init__(self, solvers: Sequence[Solver], workers: int | Mapping[str, int] = 1) -> None:
        by_name = workers if isinstance(workers, Mapping) else {s.name: workers for s in solvers}
        if min(by_name.values(), default=1) < 1:
            raise ValueError("a solver needs a worker")
        self._keeper = ThreadPoolExecutor(1, thread_name_prefix="solver-pool")
        self._lock = threading.Lock()
        self._closed = False
        self._workers = {
            solver.name: _Workers(solver, self._keeper, by_name.get(solver.name, 1))
            for solver in solvers
        }
        if len(self._workers) < len(solvers):
            raise ValueError("two solvers with one name")

    def warm_up(
        self, timeout_s: float = 60.0, stopping: threading.Event | None = None
    ) -> dict[str, str]:
        """Start all workers and import what they need.

        Args:
            timeout_s: how long they have.
            stopping: gives up early when it is set.

        Returns:
            Reason by name of each solver that is not warm after the timeout; empty if all are.
        """
        ends = time.monotonic() + timeout_s
        futures = [(name, f) for name, w in self._workers.items() for f in w.warm_up()]
        waiting = {future for _, future in futures}
        while waiting and (left := ends - time.monotonic()) > 0:
            if stopping is not None and stopping.is_set():
                break
            waiting = wait(waiting, timeout=min(left, _LOOK_EVERY_S)).not_done
        faults: dict[str, str] = {}
        for name, future in futures:
            try:
                future.result(timeout=0.0)
            except (Exception, CancelledError) as error:
                future.cancel()
                faults[name] = error_line(error)
        return faults

    def __call__(self, jobs: Sequence[Job], deadline_s: float) -> list[Outcome]:
        """Run the jobs side by side, as many of one solver at once as it has workers.

        Jobs of one solver that have to queue share the deadline.
        """
        began = time.monotonic()
        count = Counter(job.solver for job in jobs)
        futures = [self._submit(job, count[job.solver], deadline_s) for job in jobs]
        return [
            self._collect(job, future, began, deadline_s)
            for job, future in zip(jobs, futures, strict=True)
        ]

    def _submit(self, job: Job, count: int, deadline_s: float) -> Future[Outcome] | Exception:
        with self._lock:
            if self._closed:
                return RuntimeError("the pool is closed")
            try:
                workers = self._workers[job.solver]
                share_s = deadline_s / math.ceil(count / workers.size)
                return workers.submit(job.problem, share_s, job.seed)
            except Exception as error:
                return error

    def _collect(
        self, job: Job, future: Future[Outcome] | Exception, began: float, deadline_s: float
    ) -> Outcome:
        try:
            if isinstance(future, Exception):
                raise future
            left = deadline_s + GRACE_S - (time.monotonic() - began)
            outcome = future.result(timeout=max(0.0, left))
            if not isinstance(outcome, Outcome):
                raise TypeError(f"answered with a {type(outcome).__name__}")
            return outcome
        except (TimeoutError, CancelledError):
            # Cancelling kills the worker if it is at it; another takes its place.
            if isinstance(future, Future):
                future.cancel()
            reason = f"no answer within {deadline_s:g} s; worker replaced"
            return self._fault(job, "timeout", reason, began)
        except Exception as error:
            log.warning("solver %s failed: %s", job.solver, error_line(error))
            return self._fault(job, "failed", error_line(error), began)

    @staticmethod
    def _fault(
        job: Job, status: Literal["timeout", "failed"], reason: str, began: float
    ) -> Outcome:
        return Outcome(job.solver, status, None, time.monotonic() - began, reason=reason)

    def close(self) -> None:
        """Stop all workers, whatever they are doing; callers that wait get no answer."""
        with self._lock:
            self._closed = True
            for worker in self._workers.values():
                worker.stop()
        self._keeper.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def error_line(error: BaseException) -> str:
    """Kind and words of an error, in one line of at most some 200 characters."""
    text = " ".join(str(error).split())[:200]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def solve_here(solvers: Sequence[Solver]) -> Solve:
    """The same without processes or hard deadlines: for tools that solve once, and for tests."""
    by_name = {solver.name: solver for solver in solvers}

    def solve(jobs: Sequence[Job], deadline_s: float) -> list[Outcome]:
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
