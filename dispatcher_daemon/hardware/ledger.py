"""The jobs that matter now, in memory and in the database."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from typing import Literal, Protocol

from dispatcher_daemon.hardware.budget import DAY_S, counts, used_s
from slipstream.service import LogLimiter
from storage import QuantumJob, StorageError

log = logging.getLogger(__name__)

DeviceKind = Literal["noise-model", "hardware"]
"""A simulator that stands in for the device, or the device."""


class JobStore(Protocol):
    """What the ledger needs of the database."""

    def save_job(self, job: QuantumJob) -> None:
        """Store durably, or raise StorageError."""
        ...

    def jobs_since(self, finished_ns: int) -> Sequence[QuantumJob]:
        """Jobs that are open, or over since then."""
        ...


class Ledger:
    """All jobs that are open or count in the budget; any thread may ask, one writes.

    What the database refuses for the moment is kept here and stored as soon as it can be; but a
    job is only begun once it is stored.

    Args:
        store: database; what it holds from before is taken over.
        kind: of the device; the jobs of another kind are none of this ledger's.
        clock_ns: UTC, at an even pace (`SteadyClock`).
        day_s: the budget's day.

    Raises:
        StorageError: the database cannot be read.
    """

    def __init__(
        self,
        store: JobStore,
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
        """All of them, oldest first."""
        with self._lock:
            return list(self._jobs.values())

    def pending(self) -> list[QuantumJob]:
        """Those that may still cost device time."""
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
        """Keep what is new about a job, and store it now or later."""
        with self._lock:
            self._jobs[job.tag] = job
        self._unstored.add(job.tag)
        self.flush()

    def flush(self) -> None:
        """Store what is not stored yet."""
        for tag in tuple(self._unstored):
            try:
                self._store.save_job(self[tag])
            except Exception as error:
                if self._limiter.allow("unstored"):
                    log.warning("news of quantum job %s could not be stored yet: %s", tag, error)
                if isinstance(error, StorageError):
                    return
                # This one is refused, not all of them.
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
