"""A cycle's request for an answer of the device, shared by the cycle's and the job thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from dispatcher_daemon.forms import Problem
from dispatcher_daemon.solvers.protocol import Outcome


class JobRequest:
    """One problem of one cycle; open until it is answered or declined, or the cycle closes it.

    Attributes:
        problem: to be solved.
        problem_key: see `circuits.problem_key`.
        seed: of everything random in it.
        cycle: number of the cycle.
        ends_at: when the cycle closes it at the latest, by the clock, s.
    """

    def __init__(
        self,
        problem: Problem,
        problem_key: str,
        seed: int,
        cycle: int,
        ends_at: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.problem, self.problem_key, self.seed, self.cycle = problem, problem_key, seed, cycle
        self.ends_at = ends_at
        self._clock = clock
        self._lock = threading.Lock()
        self._settled = threading.Event()
        self._closed = False
        self._outcome: Outcome | None = None
        self._refusal: str | None = None
        self._status, self._since, self._timed = "the device's worker was busy", clock(), True

    @property
    def open(self) -> bool:
        """True while the cycle may still take an answer."""
        return not self._closed and not self._settled.is_set()

    def set_status(self, line: str, since: float | None = None, *, timed: bool = True) -> None:
        """Note the present step, which is the reason if the cycle closes the request during it.

        Args:
            since: when the step began, by the clock, s; None: now.
            timed: whether the reason says how long it has taken.
        """
        with self._lock:
            self._status, self._timed = line, timed
            self._since = self._clock() if since is None else since

    def decline(self, line: str) -> None:
        """Settle it without an answer, for this reason."""
        with self._lock:
            if not self._closed and not self._settled.is_set():
                self._refusal = line
                self._settled.set()

    def answer(self, outcome: Outcome) -> bool:
        """Settle it with an answer; False if it is settled or closed already."""
        with self._lock:
            if self._closed or self._settled.is_set():
                return False
            self._outcome = outcome
            self._settled.set()
            return True

    def wait(self, seconds: float) -> None:
        """Wait until it is settled, at most so long."""
        self._settled.wait(max(0.0, seconds))

    def close(self) -> tuple[Outcome | None, str]:
        """Close it and return the answer, or None and the reason."""
        with self._lock:
            self._closed = True
            if self._outcome is not None:
                return self._outcome, ""
            after_s = max(0.0, self._clock() - self._since)
            status = f"{self._status} after {after_s:.1f} s" if self._timed else self._status
            return None, self._refusal or status
