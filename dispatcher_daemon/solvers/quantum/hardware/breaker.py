"""A circuit breaker: after repeated faults nothing is submitted for a while, then one trial job.

Only a good answer resets the count of faults. An accepted job does not: a service that accepts jobs
and answers garbage would never open the breaker.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Literal

from dispatcher_daemon.solvers.quantum.backends.jobs import FaultKind

_MAX_RETRY_S: Final = 86_400.0

BreakerState = Literal["closed", "open", "half-open"]


@dataclass(frozen=True)
class JobLimits:
    """Times and counts of a device's jobs and of its circuit breaker.

    Attributes:
        poll_s: from submitting a job to its first poll; grows by half with each poll.
        max_poll_s: between two polls, at most.
        call_timeout_s: of one call of the service; a longer one is ended with its process.
        job_timeout_s: age from which a pending job is cancelled, and an unused answer is late.
        lost_after_s: a job that the service does not know for so long is given up.
        fault_threshold: number of faults, without a good answer in between, that opens the breaker.
        open_s: first open time; it doubles each time the breaker opens again.
        max_open_s: longest open time, and the open time after refused credentials.
    """

    poll_s: float = 1.0
    max_poll_s: float = 60.0
    call_timeout_s: float = 20.0
    job_timeout_s: float = 1800.0
    lost_after_s: float = 300.0
    fault_threshold: int = 3
    open_s: float = 60.0
    max_open_s: float = 3600.0


class CircuitBreaker:
    """The breaker of one device; one thread changes it, any may read `state` and `refusal`.

    Args:
        limits: when it opens, and for how long.
        clock: monotonic time, s.
    """

    def __init__(self, limits: JobLimits, clock: Callable[[], float]) -> None:
        self._limits = limits
        self._clock = clock
        self._faults = 0
        self._openings = 0
        self._open_until: float | None = None
        self._trial_pending = False
        self._reason = ""

    @property
    def state(self) -> BreakerState:
        """Closed, open, or half-open: one trial job may be, or is being, submitted."""
        until = self._open_until
        if until is None:
            return "closed"
        return "open" if self._clock() < until else "half-open"

    def refusal(self) -> str | None:
        """Why nothing may be submitted now; None if something may."""
        open_until = self._open_until
        if open_until is None:
            return None
        left_s = open_until - self._clock()
        if left_s > 0:
            until = datetime.fromtimestamp(datetime.now(UTC).timestamp() + left_s, UTC)
            return f"breaker open until {until:%H:%M:%S} UTC: {self._reason}"
        if self._trial_pending:
            return f"breaker half-open, one job is on trial: {self._reason}"
        return None

    def submitting(self) -> None:
        """A job is about to be submitted; it is the trial job if the breaker is half-open."""
        self._trial_pending = self._open_until is not None

    def withdrawn(self) -> None:
        """The job never reached the service: another trial job may be submitted."""
        self._trial_pending = False

    def accepted(self) -> None:
        """The service accepted a job: a breaker that was open closes, the next fault reopens it."""
        if self._open_until is not None:
            self._open_until, self._trial_pending = None, False
            self._faults = self._limits.fault_threshold - 1

    def answered(self) -> None:
        """A good answer came."""
        self._faults = self._openings = 0
        self._open_until, self._trial_pending = None, False

    def fault(self, kind: FaultKind, reason: str, retry_s: float | None = None) -> None:
        """The service failed.

        Args:
            kind: "refused" (credentials) opens the breaker for the longest time; "limited" for the
                time that the service names, but no less than the first open time.
            reason: in one line.
            retry_s: the time that the service names, s.
        """
        self._reason = reason
        self._faults += 1
        if kind == "refused":
            self._open(self._limits.max_open_s)
        elif kind == "limited":
            if retry_s is not None and 0 <= retry_s <= _MAX_RETRY_S:
                self._open(max(retry_s, self._limits.open_s))
            else:
                self._open(self._next_open_s())
        elif self._trial_pending or self._faults >= self._limits.fault_threshold:
            self._open(self._next_open_s())

    def _next_open_s(self) -> float:
        open_s = self._limits.open_s * 2.0 ** min(self._openings, 60)
        return min(open_s, self._limits.max_open_s)

    def _open(self, open_s: float) -> None:
        if self.state == "open":
            # Older jobs are still polled while it is open; their faults do not prolong that.
            return
        self._openings += 1
        self._trial_pending = False
        self._open_until = self._clock() + open_s
