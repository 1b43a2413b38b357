"""A circuit breaker: after repeated faults nothing is submitted for a while, then one job on trial.

Only a good answer makes up for faults. A job that the service merely takes does not, or a service
that takes jobs and answers garbage would never be left alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, Literal

from dispatcher_daemon.solvers.quantum.backends.jobs import FaultKind

_LONGEST_RETRY_S: Final = 86_400.0

BreakerState = Literal["closed", "open", "half-open"]


@dataclass(frozen=True)
class Patience:
    """When the breaker opens, and for how long.

    Attributes:
        faults: so many without a good answer in between open it.
        rest_s: the first rest; each further one is twice as long.
        most_rest_s: the longest, and the rest after refused credentials.
    """

    faults: int
    rest_s: float
    most_rest_s: float


class Breaker:
    """The state of one device's breaker; changed by one thread, `state` and `refusal` are for any.

    Args:
        patience: its limits.
        clock: seconds, monotonic.
    """

    def __init__(self, patience: Patience, clock: Callable[[], float]) -> None:
        self._patience = patience
        self._clock = clock
        self._faults = 0
        self._rests = 0
        self._open_until: float | None = None
        self._trying = False
        self._why = ""

    @property
    def state(self) -> BreakerState:
        """Closed, open, or half-open: one job may be, or is being, tried."""
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
            return f"breaker open until {until:%H:%M:%S} UTC: {self._why}"
        return f"breaker half-open, one job is on trial: {self._why}" if self._trying else None

    def submitting(self) -> None:
        """A job is about to be submitted; on trial, if the breaker is half-open."""
        self._trying = self._open_until is not None

    def withdrawn(self) -> None:
        """The job never reached the service: another one may be tried."""
        self._trying = False

    def submitted(self) -> None:
        """The service took a job: after a rest it is on probation until a good answer."""
        if self._open_until is not None:
            self._open_until, self._trying = None, False
            self._faults = self._patience.faults - 1

    def answered(self) -> None:
        """A good answer came."""
        self._faults = self._rests = 0
        self._open_until, self._trying = None, False

    def fault(self, kind: FaultKind, why: str, retry_s: float | None = None) -> None:
        """The service did not do what it was asked.

        Args:
            kind: refused credentials rest for longest; "limited" for as long as the service says,
                and no less than the first rest.
            why: in one line.
            retry_s: that time.
        """
        self._why = why
        self._faults += 1
        if kind == "refused":
            self._open(self._patience.most_rest_s)
        elif kind == "limited":
            believed = retry_s if retry_s is not None and 0 <= retry_s <= _LONGEST_RETRY_S else None
            self._open(self._rest_s() if believed is None else max(believed, self._patience.rest_s))
        elif self._trying or self._faults >= self._patience.faults:
            self._open(self._rest_s())

    def _rest_s(self) -> float:
        rest_s = self._patience.rest_s * 2.0 ** min(self._rests, 60)
        return min(rest_s, self._patience.most_rest_s)

    def _open(self, rest_s: float) -> None:
        if self.state == "open":
            # Looks at older jobs go on while it is open; their faults prolong nothing.
            return
        self._rests += 1
        self._trying = False
        self._open_until = self._clock() + rest_s
