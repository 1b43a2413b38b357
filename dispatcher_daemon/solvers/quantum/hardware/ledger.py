"""Jobs in memory and in the database, and the device time that they use of a rolling day's budget.

A rolling day, not a calendar day: at midnight the latter would let twice its budget through within
an hour. A job counts from before it is submitted until a day after it was found to be over: with
its charge once that is known, and with its estimate, or more, until then. So whenever in a day a
job ran, it counts against each job submitted later in that day.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from typing import Final, Literal

from slipstream.service import LogLimiter
from storage import Database, QuantumJob, StorageError

log = logging.getLogger(__name__)

DAY_S: Final = 86_400.0

DeviceKind = Literal["noise-model", "hardware"]
"""A simulator that stands in for the device, or the device."""


class MonotonicUtcClock:
    """UTC, ns: the wall clock's time at the start plus the monotonic time since.

    Setting the wall clock while the process runs would age jobs or free budget.
    """

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._monotonic_ns = monotonic_ns
        self._offset_ns = wall_ns() - monotonic_ns()

    def __call__(self) -> int:
        """UTC, ns."""
        return self._offset_ns + self._monotonic_ns()


def counted_s(job: QuantumJob) -> float:
    """Device time that a job counts for, s."""
    if not job.open and job.usage_s is not None:
        return job.usage_s
    return max(job.estimate_s, job.usage_s or 0.0)


def counts(job: QuantumJob, now_ns: int, day_s: float = DAY_S) -> bool:
    """True while a job counts."""
    return job.open or job.finished_ns is None or job.finished_ns > now_ns - int(day_s * 1e9)


def used_s(jobs: Iterable[QuantumJob], now_ns: int, day_s: float = DAY_S) -> float:
    """Device time charged or reserved in the day up to now, s."""
    return sum(counted_s(job) for job in jobs if counts(job, now_ns, day_s))


def budget_refusal(used: float, estimate_s: float, budget_s: float) -> str | None:
    """Why no job of that estimate may be submitted; None if it may.

    Args:
        used: device time charged or reserved, s.
    """
    if used + estimate_s <= budget_s:
        return None
    line = f"budget of {budget_s:g} s a day used up: {used:.1f} s charged or reserved"
    return f"{line}, the job may take {estimate_s:.1f} s" if estimate_s else line


class Ledger:
    """All jobs that are open or count in the budget; one thread writes, any may read.

    An update that the database refuses is kept here and stored as soon as possible; but a job only
    begins once it is stored.

    Args:
        store: the jobs in it are loaded.
        kind: of the device; jobs of the other kind are ignored.
        clock_ns: UTC, ns (`MonotonicUtcClock`).
        day_s: length of the budget's day, s.

    Raises:
        StorageError: the database cannot be read.
    """

    def __init__(
        self,
        store: Database,
        kind: DeviceKind,
        clock_ns: Callable[[], int],
        day_s: float = DAY_S,
    ) -> None:
        self._store = store
        self._clock_ns = clock_ns
        self._day_s = day_s
        self._lock = threading.Lock()
        self._unstored: set[str] = set()
        self._limiter = LogLimiter()
        since_ns = max(0, clock_ns() - int(day_s * 1e9))
        self._jobs = {job.tag: job for job in store.jobs_since(since_ns) if job.kind == kind}

    def __getitem__(self, tag: str) -> QuantumJob:
        with self._lock:
            return self._jobs[tag]

    def jobs(self) -> list[QuantumJob]:
        """All jobs, oldest first."""
        with self._lock:
            return list(self._jobs.values())

    def pending(self) -> list[QuantumJob]:
        """Jobs that may still cost device time."""
        return [job for job in self.jobs() if job.open]

    def used_s(self) -> float:
        """Device time charged or reserved in the last day, s."""
        return used_s(self.jobs(), self._clock_ns(), self._day_s)

    def begin(self, job: QuantumJob) -> None:
        """Store a job that is about to be submitted.

        Raises:
            StorageError: it is not stored, so it must not be submitted.
        """
        self._store.save_job(job)
        with self._lock:
            self._jobs[job.tag] = job

    def update(self, job: QuantumJob) -> None:
        """Take in a job's new state, and store it now or later."""
        with self._lock:
            self._jobs[job.tag] = job
        self._unstored.add(job.tag)
        self.flush()

    def flush(self) -> None:
        """Store the updates that are not stored yet."""
        for tag in tuple(self._unstored):
            try:
                self._store.save_job(self[tag])
            except Exception as error:
                if self._limiter.allow("unstored"):
                    log.warning("update of quantum job %s could not be stored yet: %s", tag, error)
                if isinstance(error, StorageError):
                    return
                # Only this job is refused; the others may still be stored.
                continue
            self._unstored.discard(tag)

    def forget(self) -> set[str]:
        """Drop jobs that no longer count; returns their tags."""
        now_ns = self._clock_ns()
        with self._lock:
            gone = {
                tag
                for tag, job in self._jobs.items()
                if not counts(job, now_ns, self._day_s) and tag not in self._unstored
            }
            for tag in gone:
                del self._jobs[tag]
        return gone
