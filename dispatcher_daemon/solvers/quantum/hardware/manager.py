"""The job manager between a dispatch cycle and a quantum device: a `Solve` around the solver pool.

The pool answers all jobs, the device's own solver on a simulator; beside it the device is asked.
When the cycle goes on, the device's answer is taken if it is there, else the simulator's, with the
reason. Whatever the device does, the cycle goes on once the pool's answers are there and the wait,
which leaves a reserve for what comes after the solvers, is over.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import Self

from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.hardware.circuits import ChainCircuitBuilder, problem_key
from dispatcher_daemon.solvers.quantum.hardware.ledger import DeviceKind
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.service import ServiceFactory
from dispatcher_daemon.solvers.quantum.hardware.thread import JobThread
from dispatcher_daemon.solvers.quantum.lc_qaoa import LcQaoaSolver
from dispatcher_daemon.solvers.workers import RESERVE, PoolJob, Solve
from slipstream.messages import HardwareHealth
from storage import Database


class JobManager:
    """Asks a device beside the solver pool; a context manager, and a `Solve`.

    Args:
        solve: the solver pool; must not be closed before the job manager.
        thread: of the device's jobs; started and stopped with the job manager.
        wait_s: how long a cycle waits for the device once the pool is done, over all its calls, s.
        cycle_s: deadline of a cycle from its beginning, s; waiting ends at 1 - `RESERVE` of it.
    """

    def __init__(
        self, solve: Solve, thread: JobThread, wait_s: float, cycle_s: float = math.inf
    ) -> None:
        self._solve = solve
        self._thread = thread
        self._wait_s = wait_s
        self._wait_left_s = wait_s
        self._cycle_s = cycle_s
        self._wait_ends_at = math.inf
        self._cycle = 0

    def begin_cycle(self, number: int) -> None:
        """Set the number of the cycle that begins now, to which the next calls belong."""
        self._wait_ends_at = time.monotonic() + (1 - RESERVE) * self._cycle_s
        self._cycle, self._wait_left_s = number, self._wait_s
        self._thread.begin_cycle()

    def __call__(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """See `Solve`."""
        began = time.monotonic()
        ends_at = min(began + deadline_s, self._wait_ends_at)
        builder = self._thread.builder
        requests = {
            position: JobRequest(
                job.problem,
                problem_key(job.problem, builder.encoding),
                job.seed,
                self._cycle,
                ends_at,
            )
            for position, job in enumerate(jobs)
            if job.solver == builder.name
        }
        self._thread.add(requests.values())
        outcomes = self._solve(jobs, deadline_s)
        for position, request in requests.items():
            waiting = time.monotonic()
            request.wait(min(ends_at - waiting, self._wait_left_s))
            waited_s = time.monotonic() - waiting
            self._wait_left_s = max(0.0, self._wait_left_s - waited_s)
            answer, reason = request.close()
            if answer is not None:
                outcomes[position] = replace(answer, wall_s=time.monotonic() - began)
            else:
                outcomes[position] = _with_fallback(outcomes[position], reason)
        return outcomes

    def health(self) -> HardwareHealth:
        """State of the device's jobs, budget and breaker."""
        return self._thread.health()

    def close(self) -> None:
        """Stop asking; jobs at the service stay there and are found again."""
        self._thread.close()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _with_fallback(outcome: Outcome, reason: str) -> Outcome:
    """The simulator's outcome, with the reason why it is not the device's."""
    if outcome.execution is not None:
        outcome = replace(outcome, execution=replace(outcome.execution, fallback=reason))
    if outcome.selected is None:
        line = f"{outcome.reason or outcome.status}; the device: {reason}"
        outcome = replace(outcome, reason=line)
    return outcome


def device_kind(backend: str) -> DeviceKind:
    """Whether it is a device, or a simulator that stands in for one."""
    return "hardware" if backend.startswith("ibm:") else "noise-model"


def open_job_manager(
    settings: DispatcherSettings, solve: Solve, store: Database
) -> JobManager | nullcontext[None]:
    """The job manager of the configured device, not started; a context of None without one.

    Raises:
        StorageError: the ledger cannot be read.
    """
    hardware = settings.hardware
    if not hardware.backend:
        return nullcontext()
    solver = LcQaoaSolver(settings.lc_qaoa, settings.gamma)
    factory, kind = ServiceFactory(hardware.backend), device_kind(hardware.backend)
    thread = JobThread(hardware, kind, factory, ChainCircuitBuilder(solver), store)
    return JobManager(solve, thread, hardware.wait_s, settings.deadline_s)
