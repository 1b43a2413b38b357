"""The job manager beside the pool, with a worker process and a service that outlives it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import psutil
import pytest

from dispatcher_daemon.forms.problem import ArcProblem
from dispatcher_daemon.settings import DispatcherSettings, HardwareSettings
from dispatcher_daemon.solvers.protocol import Execution, Outcome
from dispatcher_daemon.solvers.quantum.hardware.breaker import JobLimits
from dispatcher_daemon.solvers.quantum.hardware.ledger import MonotonicUtcClock
from dispatcher_daemon.solvers.quantum.hardware.manager import (
    JobManager,
    device_kind,
    open_job_manager,
)
from dispatcher_daemon.solvers.quantum.hardware.request import JobRequest
from dispatcher_daemon.solvers.quantum.hardware.runner import JobRunner
from dispatcher_daemon.solvers.quantum.hardware.service import ServiceFactory
from dispatcher_daemon.solvers.quantum.hardware.thread import JobThread
from dispatcher_daemon.solvers.workers.pool import PoolJob, Solve, solve_in_process
from slipstream.errors import InputError
from slipstream_lab.benchmarks.quantum.faulty_service import FaultyServiceFactory, ServiceRecords
from storage import Database, QuantumJob, open_database

from .light_builder import LightBuilder

Demo = Callable[..., ArcProblem]

SETTINGS = HardwareSettings(backend="ibm:faulty", shots=256, wait_s=30.0)
LIMITS = JobLimits(poll_s=0.05, max_poll_s=0.2, call_timeout_s=0.5, fault_threshold=9)


def aer(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
    """A pool whose simulator answers at once."""
    ran = Execution("aer", "simulated", "ramp", 2, 4, 40, 0.0, 0.1)
    return [
        Outcome(
            job.solver,
            "feasible",
            frozenset({0}),
            0.1,
            execution=ran if job.solver == "lc-qaoa" else None,
        )
        for job in jobs
    ]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    """A real ledger."""
    with open_database(f"sqlite:///{tmp_path}/cycles.db") as opened:
        yield opened


@pytest.fixture
def records(tmp_path: Path) -> ServiceRecords:
    """The service's side: all goes well until told otherwise."""
    return ServiceRecords(tmp_path / "service.db")


@pytest.fixture
def open_manager(
    database: Database, records: ServiceRecords
) -> Iterator[Callable[..., JobManager]]:
    """Opens managers, one after the other; each closes the one before."""
    managers: list[JobManager] = []

    def make(
        solve: Solve = aer, *, wait_s: float = 30.0, call_timeout_s: float = 0.5
    ) -> JobManager:
        while managers:
            managers.pop().close()
        thread = JobThread(
            SETTINGS,
            "hardware",
            FaultyServiceFactory(str(records.path)),
            LightBuilder(),
            database,
            replace(LIMITS, call_timeout_s=call_timeout_s),
        )
        manager = JobManager(solve, thread, wait_s).__enter__()
        managers.append(manager)
        return manager

    yield make
    while managers:
        managers.pop().close()


def ask(manager: JobManager, problem: ArcProblem, deadline_s: float, cycle: int) -> Outcome:
    """One cycle; other solvers' answers must come through unchanged."""
    manager.begin_cycle(cycle)
    jobs = [PoolJob("exact", problem.without_platooning(), 1), PoolJob("lc-qaoa", problem, 1)]
    exact, chain = manager(jobs, deadline_s)
    assert exact == aer(jobs[:1], deadline_s)[0]
    return chain


def the_read_job(database: Database) -> QuantumJob:
    """The only job; that it was read is stored just after the cycle has its answer."""
    until = time.monotonic() + 60
    while (job := database.jobs_since(0)[0]).answer is None and time.monotonic() < until:
        time.sleep(0.01)
    assert len(database.jobs_since(0)) == 1
    return job


def _forked() -> set[psutil.Process]:
    """Workers of all fork servers of this process, whichever test started them."""
    servers = [p for p in psutil.Process().children() if "forkserver" in " ".join(p.cmdline())]
    return {worker for server in servers for worker in server.children()}


@pytest.mark.long
@pytest.mark.process
def test_hung_in_submit_and_found_by_its_tag(
    open_manager: Callable[..., JobManager],
    records: ServiceRecords,
    database: Database,
    demo_arcs: Demo,
) -> None:
    """The worker is killed in the call, the next one finds the job, the same cycle has its answer;
    the ledger agrees with the service's records, and no worker is left over.
    """
    records.expect({"submit": {"hangs but taken": 1}})
    before = _forked()
    manager = open_manager()
    outcome = ask(manager, demo_arcs(avenue_east=1), 60.0, 1)
    assert outcome.execution is not None
    assert (outcome.execution.kind, outcome.execution.fallback) == ("hardware", None)
    job = the_read_job(database)
    (theirs,) = records.jobs()
    assert (job.state, job.answer, job.job_id, job.tag) == (
        "done",
        "used",
        theirs["id"],
        theirs["tag"],
    )
    assert outcome.execution.job == theirs["id"]
    assert outcome.execution.two_qubit_depth == 4
    assert (job.usage_s, manager.health().used_s) == (theirs["usage"], theirs["usage"])
    # The killed one is a child of its server until that has read how it ended.
    until = time.monotonic() + 60
    while len(workers := _forked() - before) > 1:
        assert time.monotonic() < until
        time.sleep(0.01)
    manager.close()
    assert len(workers) == 1
    psutil.wait_procs(workers, timeout=5)
    assert not any(worker.is_running() for worker in workers)


@pytest.mark.long
@pytest.mark.process
def test_a_hanging_poll_holds_no_cycle_up_and_a_restart_picks_the_job_up(
    open_manager: Callable[..., JobManager],
    records: ServiceRecords,
    database: Database,
    demo_arcs: Demo,
) -> None:
    """The simulator's answer goes out with the reason; the next manager has the device's."""

    def until_it_is_out(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        ends = time.monotonic() + 30.0
        while time.monotonic() < ends and not any(j.job_id for j in database.jobs_since(0)):
            time.sleep(0.02)
        return aer(jobs, deadline_s)

    records.expect({"call": {"hangs": 1}})
    manager = open_manager(until_it_is_out, wait_s=0.6)
    began = time.monotonic()
    outcome = ask(manager, demo_arcs(avenue_east=1), 60.0, 1)
    waited_s = time.monotonic() - began
    assert outcome.execution is not None
    assert outcome.execution.kind == "simulated"
    assert " still queued after " in (outcome.execution.fallback or "")
    records.expect({})
    manager = open_manager(call_timeout_s=20.0)
    outcome = ask(manager, demo_arcs(avenue_east=1, avenue_west=1), 60.0, 2)
    assert outcome.execution is not None
    assert outcome.execution.kind == "hardware"
    job = the_read_job(database)
    assert (job.cycle, job.answer_cycle) == (1, 2)
    assert waited_s < 30.0


class Stub:
    """A job thread that settles a request at once, without a thread or a worker."""

    builder = LightBuilder()

    def __init__(self, deal: Callable[[JobRequest], object]) -> None:
        self._deal = deal
        self.cycles = 0

    def begin_cycle(self) -> None:
        """Counts them."""
        self.cycles += 1

    def add(self, requests: Iterable[JobRequest]) -> None:
        """Deal with each."""
        for request in requests:
            self._deal(request)


def test_refusals_are_told_at_once(demo_arcs: Demo) -> None:
    """Nothing to wait for: the cycle goes on when the pool is done, not at its deadline."""
    manager = JobManager(
        aer, cast(JobThread, Stub(lambda t: t.decline("401: credentials refused"))), 60.0
    )
    began = time.monotonic()
    outcome = ask(manager, demo_arcs(), 60.0, 1)
    assert time.monotonic() - began < 5.0
    assert outcome.execution is not None
    assert outcome.execution.fallback == "401: credentials refused"
    assert outcome.execution.kind == "simulated"


@pytest.mark.long
@pytest.mark.slow
def test_blocks_of_a_cycle_share_its_wait(demo_arcs: Demo) -> None:
    """Waiting for the device ends at the deadline of a call, and is limited over all of them."""
    manager = JobManager(
        aer, cast(JobThread, Stub(lambda t: t.set_status("job j still queued"))), 0.5
    )
    for cycle, deadline_s, first_s, calls in ((1, 0.2, 0.2, 30), (2, 9.0, 0.5, 12)):
        manager.begin_cycle(cycle)
        waits = []
        for _ in range(calls):
            began = time.monotonic()
            (outcome,) = manager([PoolJob("lc-qaoa", demo_arcs(), 1)], deadline_s)
            waits.append(time.monotonic() - began)
            assert outcome.execution is not None
            assert "job j still queued after" in (outcome.execution.fallback or "")
        assert waits[0] >= first_s - 0.01
        # On a busy machine each wait may end late, which the next ones make up for.
        assert 0.49 <= sum(waits) < 4


@pytest.mark.long
def test_waiting_leaves_a_reserve_of_the_cycles_deadline(demo_arcs: Demo) -> None:
    """What a cycle has done before its solvers, and what they took, comes off the wait."""
    manager = JobManager(
        aer, cast(JobThread, Stub(lambda t: t.set_status("job j still queued"))), 60.0, 5.0
    )
    before = time.monotonic()
    manager.begin_cycle(1)
    time.sleep(1.5)
    manager([PoolJob("lc-qaoa", demo_arcs(), 1)], 5.0)
    # Without the reserve 5.0, were the wait counted from the solvers' begin 5.5.
    assert 3.95 < time.monotonic() - before < 4.9


@pytest.mark.process
def test_a_problem_that_breaks_the_runner_is_declined(
    open_manager: Callable[..., JobManager], demo_arcs: Demo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fault of our own is told at once; the cycle does not wait for what will not come."""

    def broken(*_: object) -> None:
        raise KeyError("ours")

    monkeypatch.setattr(JobRunner, "serve", broken)
    outcome = ask(open_manager(wait_s=30.0), demo_arcs(), 60.0, 1)
    assert outcome.execution is not None
    assert outcome.execution.fallback == "the device could not be asked: KeyError: 'ours'"


def test_the_devices_answer_goes_before_the_simulators(demo_arcs: Demo) -> None:
    """It stands in the simulator's place among the outcomes, with its own account."""
    ran = Execution("boston", "hardware", "ramp", 2, 8, 48, 0.1, 3.0, job="j7")
    answer = Outcome("lc-qaoa", "feasible", frozenset({1}), 0.0, execution=ran)
    manager = JobManager(aer, cast(JobThread, Stub(lambda t: t.answer(answer))), 1.0)
    outcome = ask(manager, demo_arcs(), 1.0, 1)
    assert (outcome.selected, outcome.execution) == (frozenset({1}), ran)


def test_both_failing_is_told_of_both(demo_arcs: Demo) -> None:
    """Where the simulator has no answer either, the reason names both."""

    def silent(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        return [Outcome(job.solver, "timeout", None, 0.1, reason="too slow") for job in jobs]

    manager = JobManager(
        silent, cast(JobThread, Stub(lambda t: t.decline("429: too many requests"))), 1.0
    )
    (outcome,) = manager([PoolJob("lc-qaoa", demo_arcs(), 1)], 1.0)
    assert outcome.selected is None
    assert outcome.reason == "too slow; the device: 429: too many requests"


@pytest.mark.process
def test_closing_frees_a_waiting_cycle(
    open_manager: Callable[..., JobManager], records: ServiceRecords, demo_arcs: Demo
) -> None:
    """A dispatcher that stops waits neither for the device nor for its worker to start."""
    records.expect({"job": {"never": 1}})
    manager = open_manager(wait_s=60.0)
    answers: list[Outcome] = []
    caller = threading.Thread(target=lambda: answers.append(ask(manager, demo_arcs(), 100.0, 1)))
    caller.start()
    time.sleep(0.2)
    began = time.monotonic()
    manager.close()
    caller.join(timeout=10.0)
    assert time.monotonic() - began < 8.0
    (outcome,) = answers
    assert outcome.execution is not None
    assert outcome.execution.fallback == "the dispatcher is stopping"
    late = ask(manager, demo_arcs(), 100.0, 2)
    assert late.execution is not None
    assert late.execution.fallback == "the dispatcher is stopping"


def test_there_is_no_job_manager_without_a_device(tmp_path: Path) -> None:
    """By default nothing of it is there; opening a job manager starts no process yet."""
    with open_database(f"sqlite:///{tmp_path}/x.db") as database:
        with open_job_manager(DispatcherSettings(), solve_in_process([]), database) as none:
            assert none is None
        hardware = HardwareSettings(backend="fake:FakeBoston")
        manager = open_job_manager(
            DispatcherSettings(hardware=hardware), solve_in_process([]), database
        )
        assert isinstance(manager, JobManager)
        assert manager.health().line is None
        assert isinstance(manager._thread._ledger._clock_ns, MonotonicUtcClock)
        assert manager._cycle_s == DispatcherSettings().deadline_s
        manager.close()


def test_kinds_and_services() -> None:
    """Only IBM's are hardware; a service that does not exist is refused by name."""
    assert (device_kind("ibm:boston"), device_kind("fake:FakeBoston")) == (
        "hardware",
        "noise-model",
    )
    with pytest.raises(InputError, match="no job service"):
        ServiceFactory("aer")()
    assert ServiceFactory("ibm:least-busy").max_age_s == 3600.0
    assert (
        ServiceFactory("ibm:boston").max_age_s
        == ServiceFactory("fake:FakeBoston").max_age_s
        == float("inf")
    )
