"""The desk's thread: takes problems in, and looks after the device's jobs at all times.

Only this thread changes the ledger and calls the worker.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Final, get_args

from dispatcher_daemon import metrics
from dispatcher_daemon.hardware import calls
from dispatcher_daemon.hardware.breaker import Breaker, BreakerState, Patience
from dispatcher_daemon.hardware.budget import DAY_S
from dispatcher_daemon.hardware.calls import Opener
from dispatcher_daemon.hardware.caretaker import Caretaker
from dispatcher_daemon.hardware.ledger import DeviceKind, JobStore, Ledger
from dispatcher_daemon.hardware.making import Maker
from dispatcher_daemon.hardware.steady_clock import SteadyClock
from dispatcher_daemon.hardware.ticket import Ticket
from dispatcher_daemon.hardware.worker import GuestWorker, WorkerClosed
from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.pool import error_line
from slipstream.messages import HardwareHealth
from slipstream.service import LogLimiter
from storage import LedgerState

log = logging.getLogger(__name__)

_IDLE_S: Final = 10.0
_AFTER_FAULT_S: Final = 0.2
_WARM_UP_S: Final = 120.0
_STOPPING: Final = "the dispatcher is stopping"


class Clerk:
    """Deals with one device.

    Attributes:
        maker: see there.
        warm: set once the worker has imported what it needs, or has failed to.

    Args:
        settings: of the device.
        kind: of the device.
        opener: opens the service, in the worker process.
        maker: makes circuits and reads samples, there too.
        store: of the ledger.
        clock_ns: UTC, at an even pace; None: a `SteadyClock`.
        day_s: the budget's day.

    Raises:
        StorageError: the ledger cannot be read.
    """

    def __init__(
        self,
        settings: HardwareSettings,
        kind: DeviceKind,
        opener: Opener,
        maker: Maker,
        store: JobStore,
        clock_ns: Callable[[], int] | None = None,
        day_s: float = DAY_S,
    ) -> None:
        self.maker = maker
        self.warm = threading.Event()
        self._settings = settings
        clock_ns = clock_ns or SteadyClock()
        self._ledger = Ledger(store, kind, clock_ns, day_s)
        patience = Patience(settings.faults, settings.rest_s, settings.most_rest_s)
        self._breaker = Breaker(patience, time.monotonic)
        self._worker = GuestWorker()
        self._caretaker = Caretaker(
            settings,
            kind,
            opener,
            maker,
            self._ledger,
            self._breaker,
            self._worker.call,
            clock_ns,
        )
        self._new: deque[Ticket] = deque()
        self._out: list[Ticket] = []
        self._lock = threading.Lock()
        self._wake, self._stopping = threading.Event(), threading.Event()
        self._limiter = LogLimiter()
        self._thread = threading.Thread(target=self._run, name="guest", daemon=True)

    def start(self) -> None:
        """Start its thread, and with it the worker."""
        self._thread.start()

    def begin_cycle(self) -> None:
        """A new cycle may submit jobs again."""
        self._caretaker.begin_cycle()

    def take(self, tickets: Iterable[Ticket]) -> None:
        """Take in what a cycle wants to know."""
        with self._lock:
            given = tuple(tickets)
            self._out = [*(ticket for ticket in self._out if ticket.open), *given]
            self._new.extend(given)
        self._wake.set()
        if self._stopping.is_set():
            self._decline_all()

    def health(self) -> HardwareHealth:
        """How it stands; for any thread."""
        jobs, used_s, state = self._ledger.jobs(), self._ledger.used_s(), self._breaker.state
        in_state = Counter(job.state for job in jobs)
        for name in get_args(LedgerState):
            metrics.QUANTUM_JOBS.labels(name).set(in_state[name])
        for name in get_args(BreakerState):
            metrics.QUANTUM_BREAKER.labels(name).set(name == state)
        metrics.QUANTUM_USED_SECONDS.set(used_s)
        return HardwareHealth(
            backend=self._settings.backend,
            pending=sum(job.open for job in jobs),
            used_s=used_s,
            budget_s=self._settings.budget_s_per_day,
            breaker=state,
            line=self._caretaker.refusal(),
        )

    def close(self) -> None:
        """Stop, whatever is going on; whoever waits is told."""
        self._stopping.set()
        self._wake.set()
        self._worker.close()
        if self._thread.is_alive():
            self._thread.join()
        self._decline_all()

    def _decline_all(self) -> None:
        with self._lock:
            for ticket in self._out:
                ticket.decline(_STOPPING)

    def _run(self) -> None:
        try:
            self._step("warming up", self._warm_up)
            self.warm.set()
            while not self._stopping.is_set():
                self._step("the device", self._round)
        except WorkerClosed:
            return

    def _round(self) -> None:
        """Wait for something to do, and do it: problems of cycles first, one look after them."""
        self._step("the ledger", self._caretaker.tidy)
        self._wake.wait(self._idle_s())
        self._wake.clear()
        while self._new and not self._stopping.is_set():
            self._step("a problem", partial(self._serve, self._new.popleft()))
        if self._idle_s() <= 0 and (due := self._caretaker.next_look()) is not None:
            self._step("a job", partial(self._caretaker.look_after, due[1]))

    def _serve(self, ticket: Ticket) -> None:
        try:
            self._caretaker.serve(ticket)
        except WorkerClosed:
            raise
        except Exception as error:
            ticket.decline(f"the device could not be asked: {error_line(error)}")
            raise

    def _idle_s(self) -> float:
        due = self._caretaker.next_look()
        return _IDLE_S if due is None else min(_IDLE_S, due[0] - time.monotonic())

    def _warm_up(self) -> None:
        self._worker.call(calls.warm_up, (self.maker,), _WARM_UP_S)

    def _step(self, what: str, step: Callable[[], None]) -> None:
        """Faults of our own cost one step, not the thread."""
        try:
            step()
        except WorkerClosed:
            raise
        except Exception as error:
            if self._limiter.allow(what):
                log.exception("quantum device: looking after %s failed: %s", what, error)
            self._stopping.wait(_AFTER_FAULT_S)
