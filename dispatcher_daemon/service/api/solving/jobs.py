"""The queue of fleets to plan: bounded, one at a time, in a worker process that can be killed."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, TimeoutError
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from dispatcher_daemon.solvers.workers import Processes, error_line
from slipstream.errors import InputError

log = logging.getLogger(__name__)

JobState = Literal["waiting", "running", "done", "failed", "cancelled"]
ENDED: Final = frozenset({"done", "failed", "cancelled"})

MAX_WAITING: Final = 16
KEPT_S: Final = 3600.0
KEPT_BYTES: Final = 200_000_000
"""Results of an hour, or of fewer jobs where they would be larger than this."""
OVERHEAD_S: Final = 120.0
"""Beyond its deadline, for the start of a process, reading roads and verifying plans, s."""

_STOP_WITHIN_S: Final = 5.0
_NICENESS: Final = 10
"""The dispatcher's own cycles come first."""

Task = Callable[[], bytes]
"""Gives a result as JSON; it can be pickled."""
MakeTask = Callable[[], Task]


class FullError(Exception):
    """`MAX_WAITING` jobs wait already."""


@dataclass
class SolveJob:
    """One fleet to plan.

    Attributes:
        started_ns: UTC; None: not yet.
        ended_ns: likewise.
        result: a `SolveResult` as JSON, of one that is done.
    """

    id: str
    deadline_s: float
    make_task: MakeTask | None = field(repr=False)
    state: JobState = "waiting"
    submitted_ns: int = 0
    started_ns: int | None = None
    ended_ns: int | None = None
    reason: str | None = None
    error: BaseException | None = field(default=None, repr=False)
    result: bytes | None = field(default=None, repr=False)
    future: Future[bytes] | None = field(default=None, repr=False)


class SolveJobs:
    """Plans fleets one after the other; safe for threads."""

    def __init__(
        self,
        overhead_s: float = OVERHEAD_S,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._overhead_s, self._clock = overhead_s, clock
        self._jobs: OrderedDict[str, SolveJob] = OrderedDict()
        self._condition = threading.Condition()
        self._closed = False
        self._keeper = ThreadPoolExecutor(1, thread_name_prefix="solve-process")
        self._processes = Processes(1, self._keeper, "worker of solve jobs", _NICENESS)
        self._thread = threading.Thread(target=self._serve, name="solve-jobs", daemon=True)
        self._thread.start()

    def submit(self, deadline_s: float, make_task: MakeTask) -> SolveJob:
        """Queue one.

        Raises:
            FullError: too many wait.
        """
        with self._condition:
            self._forget()
            if sum(job.state == "waiting" for job in self._jobs.values()) >= MAX_WAITING:
                raise FullError
            job = SolveJob(secrets.token_hex(8), deadline_s, make_task, submitted_ns=self._clock())
            self._jobs[job.id] = job
            self._condition.notify_all()
            return job

    def get(self, name: str) -> SolveJob | None:
        """A job; None: there is none, or it ended too long ago."""
        with self._condition:
            self._forget()
            return self._jobs.get(name)

    def wait(self, job: SolveJob, within_s: float) -> bool:
        """Wait for a job's end, whatever it is; False: it has not ended in time."""
        with self._condition:
            return self._condition.wait_for(lambda: self._closed or job.state in ENDED, within_s)

    def wait_begun(self, job: SolveJob, within_s: float) -> bool:
        """Wait until a job's turn comes, or it ends; False: it still waits."""
        with self._condition:
            return self._condition.wait_for(
                lambda: self._closed or job.state != "waiting", within_s
            )

    def leave(self, job: SolveJob) -> None:
        """Forget a job that nobody asks for any more. One that runs goes on to its end, as the
        next one would wait for another process; what comes out is dropped.
        """
        with self._condition:
            if job.state not in ENDED:
                job.state, job.make_task = "cancelled", None
            self._jobs.pop(job.id, None)
            self._condition.notify_all()

    def cancel(self, name: str) -> SolveJob | None:
        """End a job, whatever it is doing; one that has ended stays as it is."""
        with self._condition:
            self._forget()
            job = self._jobs.get(name)
            if job is not None and job.state not in ENDED:
                self._end(job, "cancelled", "its caller cancelled it")
                if job.future is not None:
                    job.future.cancel()
            return job

    def close(self) -> None:
        """End all jobs and the worker."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()
            self._processes.stop()
        self._thread.join(_STOP_WITHIN_S)
        self._keeper.shutdown()

    def _serve(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closed or self._next() is not None)
                job = self._next()
                if self._closed or job is None:
                    return
                job.state, job.started_ns = "running", self._clock()
                make_task, job.make_task = job.make_task, None
                self._condition.notify_all()
            try:
                assert make_task is not None
                result = self._plan(job, make_task())
            except (CancelledError, TimeoutError) as error:
                job.error = error
                self._finish(job, "failed", reason=f"no plan within {self._limit_s(job):g} s")
            except InputError as error:
                job.error = error
                self._finish(job, "failed", reason=str(error))
            except Exception as error:
                log.warning("solve job %s failed: %s", job.id, error_line(error))
                job.error = error
                self._finish(job, "failed", reason=error_line(error))
            else:
                self._finish(job, "done", result=result)

    def _plan(self, job: SolveJob, task: Task) -> bytes:
        with self._condition:
            if self._closed or job.state != "running":
                raise CancelledError
            job.future = self._processes.schedule(task, (), timeout_s=self._limit_s(job))
        found: Any = job.future.result()
        return bytes(found)

    def _limit_s(self, job: SolveJob) -> float:
        return job.deadline_s + self._overhead_s

    def _finish(
        self, job: SolveJob, state: JobState, reason: str | None = None, result: bytes | None = None
    ) -> None:
        with self._condition:
            job.future = None
            if job.state == "running":
                job.result = result
                self._end(job, state, reason)

    def _end(self, job: SolveJob, state: JobState, reason: str | None) -> None:
        job.state, job.reason, job.ended_ns, job.make_task = state, reason, self._clock(), None
        self._jobs.move_to_end(job.id)
        self._condition.notify_all()

    def _next(self) -> SolveJob | None:
        return next((job for job in self._jobs.values() if job.state == "waiting"), None)

    def _forget(self) -> None:
        """Forget jobs that ended long ago, and the oldest where all are too large."""
        oldest_ns = self._clock() - round(1e9 * KEPT_S)
        ended = [job for job in self._jobs.values() if job.ended_ns is not None]
        left = sum(len(job.result or b"") for job in ended)
        for job in ended:
            if left > KEPT_BYTES or (job.ended_ns or 0) < oldest_ns:
                left -= len(job.result or b"")
                del self._jobs[job.id]
