"""The job thread: takes in requests, and polls the device's jobs at all times.

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
from dispatcher_daemon.settings import HardwareSettings
from dispatcher_daemon.solvers.quantum.hardware.breaker import (
    BreakerState,
    CircuitBreaker,
    JobLimits,
)
from dispatcher_daemon.solvers.quantum.hardware.circuits import ChainCircuitBuilder
from dispatcher_daemon.solvers.quantum.hardware.ledger import (
    DAY_S,
    DeviceKind,
    Ledger,
    MonotonicUtcClock,
)
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.runner import JobRunner
from dispatcher_daemon.solvers.quantum.hardware.service import (
    ServiceFactory,
    ServiceWorker,
    WorkerClosed,
)
from dispatcher_daemon.solvers.workers.pool import error_line
from slipstream.messages import HardwareHealth
from slipstream.service import LogLimiter
from storage import Database, LedgerState

log = logging.getLogger(__name__)

_IDLE_S: Final = 10.0
_AFTER_FAULT_S: Final = 0.2
_WARM_UP_S: Final = 120.0
_STOPPING: Final = "the dispatcher is stopping"


class JobThread:
    """The thread of one device, with its ledger, breaker and worker.

    Attributes:
        builder: builds circuits and decodes samples, in the worker.
        warm: set once the worker has imported what it needs, or has failed to.

    Args:
        factory: opens the service, in the worker.
        store: of the ledger.
        limits: of jobs and breaker; None: the usual ones.
        day_s: length of the budget's day, s.

    Raises:
        StorageError: the ledger cannot be read.
    """

    def __init__(
        self,
        settings: HardwareSettings,
        kind: DeviceKind,
        factory: ServiceFactory,
        builder: ChainCircuitBuilder,
        store: Database,
        limits: JobLimits | None = None,
        day_s: float = DAY_S,
    ) -> None:
        self.builder = builder
        self.warm = threading.Event()
        self._settings = settings
        clock_ns, limits = MonotonicUtcClock(), limits or JobLimits()
        self._ledger = Ledger(store, kind, clock_ns, day_s)
        self._breaker = CircuitBreaker(limits, time.monotonic)
        self._worker = ServiceWorker()
        self._runner = JobRunner(
            settings,
            limits,
            kind,
            factory,
            builder,
            self._ledger,
            self._breaker,
            self._worker.call,
            clock_ns,
        )
        self._new: deque[JobRequest] = deque()
        self._unsettled: list[JobRequest] = []
        self._lock = threading.Lock()
        self._wake, self._stopping = threading.Event(), threading.Event()
        self._limiter = LogLimiter()
        self._thread = threading.Thread(target=self._run, name="quantum-jobs", daemon=True)

    def start(self) -> None:
        """Start the thread, and with it the worker."""
        self._thread.start()

    def begin_cycle(self) -> None:
        """A new cycle may submit jobs again."""
        self._runner.begin_cycle()

    def add(self, requests: Iterable[JobRequest]) -> None:
        """Take in a cycle's requests."""
        with self._lock:
            given = tuple(requests)
            self._unsettled = [*(request for request in self._unsettled if request.open), *given]
            self._new.extend(given)
        self._wake.set()
        if self._stopping.is_set():
            self._decline_all()

    def health(self) -> HardwareHealth:
        """State of jobs, budget and breaker; for any thread."""
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
            line=self._runner.refusal(),
        )

    def close(self) -> None:
        """Stop, whatever is going on; open requests are declined."""
        self._stopping.set()
        self._wake.set()
        self._worker.close()
        if self._thread.is_alive():
            self._thread.join()
        self._decline_all()

    def _decline_all(self) -> None:
        with self._lock:
            for request in self._unsettled:
                request.decline(_STOPPING)

    def _run(self) -> None:
        try:
            self._step("warming up", self._warm_up)
            self.warm.set()
            while not self._stopping.is_set():
                self._step("the device", self._run_once)
        except WorkerClosed:
            return

    def _run_once(self) -> None:
        """Wait until something is due; serve all new requests first, then poll one job."""
        self._step("the ledger", self._runner.tidy)
        self._wake.wait(self._idle_s())
        self._wake.clear()
        while self._new and not self._stopping.is_set():
            self._step("a problem", partial(self._serve, self._new.popleft()))
        if self._idle_s() <= 0 and (due := self._runner.next_poll()) is not None:
            self._step("a job", partial(self._runner.poll, due[1]))

    def _serve(self, request: JobRequest) -> None:
        try:
            self._runner.serve(request)
        except WorkerClosed:
            raise
        except Exception as error:
            request.decline(f"the device could not be asked: {error_line(error)}")
            raise

    def _idle_s(self) -> float:
        due = self._runner.next_poll()
        return _IDLE_S if due is None else min(_IDLE_S, due[0] - time.monotonic())

    def _warm_up(self) -> None:
        self._worker.call(self.builder.warm_up, (), _WARM_UP_S)

    def _step(self, what: str, step: Callable[[], None]) -> None:
        """Run one step; a fault of our own ends the step, not the thread."""
        try:
            step()
        except WorkerClosed:
            raise
        except Exception as error:
            if self._limiter.allow(what):
                log.exception("quantum device: looking after %s failed: %s", what, error)
            self._stopping.wait(_AFTER_FAULT_S)
