"""What one problem of one cycle is waiting for, between the cycle's thread and the desk's."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.protocol import Outcome


class Ticket:
    """A problem handed to the desk; open until the cycle that handed it in goes on.

    Attributes:
        problem: to be solved.
        meaning: fingerprint of what its variables stand for.
        seed: of everything random in it.
        cycle: number of the cycle.
        ends: when the cycle goes on at the latest, by the clock.
    """

    def __init__(
        self,
        problem: Problem,
        meaning: str,
        seed: int,
        cycle: int,
        ends: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.problem, self.meaning, self.seed, self.cycle = problem, meaning, seed, cycle
        self.ends = ends
        self._clock = clock
        self._lock = threading.Lock()
        self._settled = threading.Event()
        self._closed = False
        self._outcome: Outcome | None = None
        self._refusal: str | None = None
        self._stage, self._since, self._timed = "the device's worker was busy", clock(), True

    @property
    def open(self) -> bool:
        """True while the cycle may still take an answer."""
        return not self._closed and not self._settled.is_set()

    def stage(self, line: str, since: float | None = None, *, timed: bool = True) -> None:
        """Say what is going on, so that a cycle that goes on can say what it did not wait for.

        Args:
            since: when that began, by the clock; None: now.
            timed: whether to say for how long it has gone on.
        """
        with self._lock:
            self._stage, self._timed = line, timed
            self._since = self._clock() if since is None else since

    def decline(self, line: str) -> None:
        """Say that there will be no answer, and why."""
        with self._lock:
            if not self._closed and not self._settled.is_set():
                self._refusal = line
                self._settled.set()

    def offer(self, outcome: Outcome) -> bool:
        """Hand over an answer; False if nobody is waiting for it any more."""
        with self._lock:
            if self._closed or self._settled.is_set():
                return False
            self._outcome = outcome
            self._settled.set()
            return True

    def wait(self, seconds: float) -> None:
        """Wait until there is an answer, or will be none, or the time is over."""
        self._settled.wait(max(0.0, seconds))

    def close(self) -> tuple[Outcome | None, str]:
        """Take what there is: an answer, or why there is none."""
        with self._lock:
            self._closed = True
            if self._outcome is not None:
                return self._outcome, ""
            after_s = max(0.0, self._clock() - self._since)
            stage = f"{self._stage} after {after_s:.1f} s" if self._timed else self._stage
            return None, self._refusal or stage
