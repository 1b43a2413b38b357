"""Scheduler of cycles: at a fixed interval, never two at once."""

from __future__ import annotations

import logging
from collections.abc import Callable
from datetime import UTC, datetime

from apscheduler.events import EVENT_JOB_ERROR, EVENT_JOB_MAX_INSTANCES, EVENT_JOB_MISSED, JobEvent
from apscheduler.executors.pool import ThreadPoolExecutor
from apscheduler.schedulers.background import BackgroundScheduler
from apscheduler.triggers.interval import IntervalTrigger

log = logging.getLogger(__name__)

_JOB = "cycle"

CLOCK_TOLERANCE_S = 1.0
"""Tolerance beyond an interval within which a run is not rescheduled, as clocks are slewed, s."""


class CycleScheduler:
    """Calls a function once it is started and then every ``interval_s``, on one thread of its own.

    A run that is due while the last one is still running is skipped and counted as overlapped. Runs
    that could not start in time are replaced by one, and counted as missed if they are later than a
    whole interval. A run that raises is logged and counted; the next one comes.

    Runs are scheduled by the wall clock. The owner calls `follow_clock` regularly, so that a clock
    that is set does not delay the next run.

    Args:
        on_fault: called with "overlapped", "missed", "raised" or "clock".
    """

    def __init__(
        self,
        run: Callable[[], None],
        interval_s: float,
        on_fault: Callable[[str], None] = lambda kind: None,
    ) -> None:
        self._on_fault = on_fault
        self._interval_s = interval_s
        self._scheduler = BackgroundScheduler(
            timezone=UTC, executors={"default": ThreadPoolExecutor(1)}
        )
        self._scheduler.add_listener(
            self._note, EVENT_JOB_MAX_INSTANCES | EVENT_JOB_MISSED | EVENT_JOB_ERROR
        )
        self._scheduler.add_job(
            run,
            IntervalTrigger(seconds=interval_s, timezone=UTC),
            id=_JOB,
            max_instances=1,
            coalesce=True,
            misfire_grace_time=max(1, int(interval_s)),
        )

    def _note(self, event: JobEvent) -> None:
        kind = {EVENT_JOB_MAX_INSTANCES: "overlapped", EVENT_JOB_MISSED: "missed"}.get(
            event.code, "raised"
        )
        if kind == "raised":
            log.error("cycle raised %r", event.exception)
        else:
            log.warning(
                "a cycle was %s",
                "left out: the last one still runs" if kind == "overlapped" else kind,
            )
        self._on_fault(kind)

    def follow_clock(self) -> bool:
        """Make the next run due now if it is further off than any run can be; True if it was.

        That happens where the wall clock has been set: back, and the next run would only come
        after the whole step; ahead, and all the runs in between would count as missed.
        """
        job = self._scheduler.get_job(_JOB)
        if job is None or job.next_run_time is None:
            return False
        now = datetime.now(UTC)
        off_s = (job.next_run_time - now).total_seconds()
        if abs(off_s) <= self._interval_s + CLOCK_TOLERANCE_S:
            return False
        self._scheduler.modify_job(_JOB, next_run_time=now)
        log.warning("the clock was set: the next cycle was %.0f s off, now it is due", off_s)
        self._on_fault("clock")
        return True

    def run_soon(self) -> bool:
        """Make the next run due now; False where none is planned."""
        job = self._scheduler.get_job(_JOB)
        if job is None:
            return False
        self._scheduler.modify_job(_JOB, next_run_time=datetime.now(UTC))
        return True

    @property
    def is_started(self) -> bool:
        """Whether runs come."""
        return bool(self._scheduler.running)

    @property
    def next_run_ns(self) -> int | None:
        """UTC of the next run; None if none is planned."""
        job = self._scheduler.get_job(_JOB)
        if not self.is_started or job is None or job.next_run_time is None:
            return None
        return int(job.next_run_time.timestamp() * 1e9)

    def start(self) -> None:
        """Begin."""
        self._scheduler.modify_job(_JOB, next_run_time=datetime.now(UTC))
        self._scheduler.start()

    def stop(self) -> None:
        """Schedule no more runs and wait for the running one."""
        if self._scheduler.running:
            self._scheduler.remove_all_jobs()
            self._scheduler.shutdown(wait=True)
