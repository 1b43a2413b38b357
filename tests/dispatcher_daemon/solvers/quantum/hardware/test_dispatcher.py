"""The dispatcher with a device beside its pool, and what its reports tell of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.plans.solver_report import solver_report
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Execution, Outcome
from dispatcher_daemon.solvers.quantum.hardware.manager import JobManager
from dispatcher_daemon.solvers.workers.pool import PoolJob, solve_in_process
from slipstream.messages import CycleReport, DispatcherHealth, HardwareHealth

HEALTH = HardwareHealth(
    backend="ibm:boston", pending=1, used_s=1.0, budget_s=60.0, breaker="closed", line=None
)
AER = Execution("aer", "simulated", "ramp", 2, 4, 40, 0.1, 0.2, fallback="job j still queued")
DEVICE = Execution("boston", "hardware", "ramp", 2, 8, 48, 0.1, 3.0, job="j7")


class ExactDevice:
    """A job manager whose device answers what the exact solver does."""

    def __init__(self) -> None:
        self.cycles: list[int] = []
        self._solve = solve_in_process([ExactSolver()])

    def begin_cycle(self, number: int) -> None:
        """Writes it down."""
        self.cycles.append(number)

    def __call__(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """All by the exact solver."""
        exact = self._solve([replace(job, solver="exact") for job in jobs], deadline_s)
        return [
            replace(o, solver=j.solver, execution=DEVICE if j.solver == "lc-qaoa" else None)
            for j, o in zip(jobs, exact, strict=True)
        ]

    def health(self) -> HardwareHealth:
        """Well."""
        return HEALTH


class Log:
    """Bus and store: keeps what is published."""

    def __init__(self) -> None:
        self.messages: list[Any] = []

    def publisher(self, key: str) -> Log:
        """Itself."""
        return self

    def put(self, message: Any) -> None:
        """Keep it."""
        self.messages.append(message)

    def record_cycle(self, *_: object) -> None:
        """Stored."""

    def next_cycle_number(self) -> int:
        """Six came before."""
        return 7

    def last_event(self, *_: object) -> None:
        """None was stored."""

    def prune(self, *_: object, **__: object) -> int:
        """Nothing is old."""
        return 0


def test_the_dispatcher_solves_through_the_job_manager(demo: RoutingProblem) -> None:
    """It learns each cycle's number, its answers are reported, its state is in the health."""
    log, device = Log(), ExactDevice()
    settings = DispatcherSettings(solvers=("exact", "lc-qaoa"))
    solve = solve_in_process([])
    dispatcher = Dispatcher(
        settings, demo.network, demo.fleet, log, log, solve, job_manager=cast(JobManager, device)
    )
    for _ in range(2):
        dispatcher.run_cycle()
    dispatcher.health.publish(None)
    assert device.cycles == [7, 8]
    report = next(m for m in log.messages if isinstance(m, CycleReport))
    assert report.status == "ok"
    exact, chain = report.solvers
    assert exact.backend is None
    assert (chain.backend, chain.backend_kind, chain.fallback, chain.two_qubit_depth) == (
        "boston",
        "hardware",
        None,
        8,
    )
    (health,) = (m for m in log.messages if isinstance(m, DispatcherHealth))
    assert health.hardware == HEALTH
    plain = Dispatcher(settings, demo.network, demo.fleet, plain_log := Log(), plain_log, solve)
    plain.health.publish(None)
    assert plain_log.messages[0].hardware is None


def test_a_fault_in_the_health_ends_no_dispatcher(
    demo: RoutingProblem, caplog: pytest.LogCaptureFixture
) -> None:
    """It is logged, once a minute; the next one is published again."""
    log, device = Log(), ExactDevice()
    dispatcher = Dispatcher(
        DispatcherSettings(),
        demo.network,
        demo.fleet,
        log,
        log,
        solve_in_process([]),
        job_manager=cast(JobManager, device),
    )
    health = device.health

    def broken() -> HardwareHealth:
        raise TypeError("'<' not supported")

    device.health = broken  # type: ignore[method-assign]
    for _ in range(3):
        dispatcher.health.publish(None)
    assert log.messages == []
    assert len(caplog.records) == 1
    device.health = health  # type: ignore[method-assign]
    dispatcher.health.publish(None)
    assert len(log.messages) == 1


def test_a_report_tells_of_a_fallback() -> None:
    """The simulator's answer goes with the reason why it is not the device's."""
    outcome = Outcome("lc-qaoa", "feasible", frozenset({0}), 0.1, execution=AER)
    report = solver_report([outcome], 1.0)
    assert (report.backend, report.backend_kind) == ("aer", "simulated")
    assert (report.fallback, report.two_qubit_depth) == ("job j still queued", 4)


@pytest.mark.parametrize("backwards", [False, True])
def test_blocks_are_told_of_together(backwards: bool) -> None:
    """One block on the device is not hidden by others that fell back; how many did is told."""
    outcomes = [
        Outcome("lc-qaoa", "feasible", frozenset({0}), 0.1, execution=ran)
        for ran in (AER, DEVICE, AER)
    ]
    report = solver_report(outcomes[::-1] if backwards else outcomes, 1.0, blocks=True)
    assert (report.backend, report.backend_kind, report.two_qubit_depth) == (
        "boston",
        "hardware",
        8,
    )
    assert report.fallback == "2 of 3 blocks: job j still queued"
    proven = Outcome("exact", "optimal", frozenset({0}), 0.1)
    classical = solver_report([proven], 1.0, blocks=True)
    assert classical.status == "feasible"
    assert (classical.backend, classical.fallback, classical.two_qubit_depth) == (None, None, None)
