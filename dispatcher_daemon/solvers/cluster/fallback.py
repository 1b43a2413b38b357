"""The cluster with this machine's processes behind it: what it does not answer is solved here."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Any, Final, ParamSpec, TypeVar

from dispatcher_daemon.solvers.cluster.calls import ClusterLost
from dispatcher_daemon.solvers.cluster.client import Cluster
from dispatcher_daemon.solvers.protocol import Outcome, Solver
from dispatcher_daemon.solvers.workers.executor import TimedExecutor
from dispatcher_daemon.solvers.workers.pool import GRACE_S, PoolJob, Solve, error_line, run_job
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor

CLUSTER_SHARE: Final = 0.6
"""Share of a time limit that the cluster has; the rest is this machine's, if there is no answer."""
_LEAST_S: Final = 0.05

P = ParamSpec("P")
T = TypeVar("T")
R = TypeVar("R")


def cluster_solve(cluster: Cluster, solvers: Sequence[Solver], local: Solve) -> Solve:
    """A `Solve` on a cluster.

    Args:
        local: solves what the cluster gives no answer for, or all while there is no cluster.
    """
    by_name = {solver.name: solver for solver in solvers}

    def solve(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        began, slots = time.monotonic(), cluster.slots
        if slots == 0:
            return local(jobs, deadline_s)
        within_s = CLUSTER_SHARE * deadline_s
        share_s = within_s / max(1, math.ceil(len(jobs) / slots))
        within_s = min(within_s + GRACE_S, deadline_s)
        futures = [
            cluster.submit(
                run_job,
                (by_name[job.solver], job.problem, share_s, job.seed),
                share_s + GRACE_S,
                within_s,
            )
            if job.solver in by_name
            else None
            for job in jobs
        ]
        answers = [_collect(job, f, began) for job, f in zip(jobs, futures, strict=True)]
        lost = [job for job, answer in zip(jobs, answers, strict=True) if answer is None]
        left_s = max(_LEAST_S, deadline_s - (time.monotonic() - began))
        made_up = iter(local(lost, left_s) if lost else ())
        return [next(made_up) if answer is None else answer for answer in answers]

    return solve


def _collect(job: PoolJob, future: Future[Any] | None, began: float) -> Outcome | None:
    """A job's outcome; None if the cluster gave no answer."""
    if future is None:
        return None
    try:
        outcome = future.result()
        if not isinstance(outcome, Outcome):
            raise TypeError(f"answered with a {type(outcome).__name__}")
        return outcome
    except ClusterLost:
        return None
    except Exception as error:
        late = isinstance(error, TimeoutError)
        reason = f"{error}; worker replaced" if late else error_line(error)
        wall_s = time.monotonic() - began
        return Outcome(job.solver, "timeout" if late else "failed", None, wall_s, reason=reason)


class ClusterExecutor(TimedExecutor):
    """Runs calls on a cluster, and in this machine's processes what it does not answer.

    Args:
        cluster: closed with it, as is `local`.
        local: this machine's processes.
        workers: processes of `local`.
    """

    def __init__(self, cluster: Cluster, local: WorkerExecutor, workers: int) -> None:
        self._cluster, self._local, self._workers = cluster, local, workers
        self._lock = threading.Lock()
        self._open = 0

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Run a call without a time limit on this machine."""
        return self._local.submit(fn, *args, **kwargs)

    def submit_within(
        self, within_s: float, limit_s: float, function: Callable[[T, float], R], argument: T
    ) -> Future[R]:
        """See `TimedExecutor`; the cluster has `CLUSTER_SHARE` of both times."""
        if self._cluster.slots == 0:
            return self._local.submit(function, argument, limit_s)
        began = time.monotonic()
        remote_s = CLUSTER_SHARE * limit_s
        remote = self._cluster.submit(
            function,
            (argument, remote_s),
            remote_s + GRACE_S,
            CLUSTER_SHARE * within_s + GRACE_S,
        )
        answer: Future[R] = Future()
        with self._lock:
            self._open += 1

        def closed(_: Future[R]) -> None:
            with self._lock:
                self._open -= 1

        def local(done: Future[R]) -> None:
            _copy(done, answer)

        def collect(done: Future[R]) -> None:
            if not isinstance(done.exception(), ClusterLost):
                _copy(done, answer)
                return
            # What else is open may be lost too and share this machine's processes.
            left_s = (within_s - (time.monotonic() - began)) / math.ceil(self._open / self._workers)
            try:
                left_s = max(_LEAST_S, min(limit_s, left_s))
                self._local.submit(function, argument, left_s).add_done_callback(local)
            except Exception as error:
                answer.set_exception(error)

        answer.add_done_callback(closed)
        remote.add_done_callback(collect)
        return answer

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Give up the cluster and stop this machine's processes."""
        self._cluster.close()
        self._local.shutdown(wait, cancel_futures=cancel_futures)


def _copy(done: Future[R], answer: Future[R]) -> None:
    if done.cancelled():
        answer.cancel()
        answer.set_running_or_notify_cancel()
        return
    error = done.exception()
    if error is None:
        answer.set_result(done.result())
    else:
        answer.set_exception(error)
