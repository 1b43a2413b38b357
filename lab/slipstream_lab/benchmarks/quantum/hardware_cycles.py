"""Dispatch cycles beside a faulty device, in this process."""

from __future__ import annotations

import random
import signal
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

import psutil

from dispatcher_daemon.fleet import load_fleet
from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.planning.plans import verify_plans
from dispatcher_daemon.service.dispatcher import (
    CycleOutcome,
    CycleRunner,
    FleetWatch,
    PlanDelivery,
    Surroundings,
)
from dispatcher_daemon.settings import DispatcherSettings, HardwareSettings, LcQaoaSettings
from dispatcher_daemon.solvers import Outcome, configured_solvers
from dispatcher_daemon.solvers.quantum import LcQaoaSolver
from dispatcher_daemon.solvers.quantum.hardware import JobLimits, JobManager, JobThread
from dispatcher_daemon.solvers.workers import RESERVE, PoolJob, Solve, SolverPool, start_fork_server
from dispatcher_daemon.traffic import SegmentTraffic, TrafficSnapshot
from slipstream.messages import Message
from slipstream.orders import FleetRecords
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream_lab.benchmarks.quantum.ansatz_builder import AnsatzBuilder
from slipstream_lab.benchmarks.quantum.faulty_service import (
    EVERYTHING,
    FaultyServiceFactory,
    ServiceRecords,
    pid_file,
)
from slipstream_lab.benchmarks.quantum.hardware_checks import DAY_S, Run, check_run
from storage import open_database

KILL_WORKER_EVERY: Final = 25
"""Cycles between two kills of the device's worker, on average."""

SETTINGS: Final = DispatcherSettings(
    solvers=("exact", "lc-qaoa"),
    deadline_s=1.5,
    interval_s=2.0,
    lc_qaoa=LcQaoaSettings(variant="ramp", shots=128),
    hardware=HardwareSettings(
        backend="ibm:faulty",
        shots=256,
        budget_s_per_day=40.0,
        max_pending_jobs=3,
        wait_s=0.6,
    ),
)

LIMITS: Final = JobLimits(
    poll_s=0.05,
    max_poll_s=0.5,
    call_timeout_s=0.5,
    job_timeout_s=5.0,
    lost_after_s=1.0,
    fault_threshold=4,
    open_s=0.3,
    max_open_s=1.5,
)


class Timed:
    """A `Solve` that knows how long its last call took, and whether a solver was too late in it.

    Args:
        solve: what is timed.
    """

    def __init__(self, solve: Solve) -> None:
        self._solve = solve
        self.wall_s = 0.0
        self.late = False

    def __call__(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """See `Solve`."""
        began = time.monotonic()
        outcomes = self._solve(jobs, deadline_s)
        self.wall_s = time.monotonic() - began
        self.late = any(outcome.status == "timeout" for outcome in outcomes)
        return outcomes


class _Nobody:
    """A bus that nobody listens to."""

    def publisher(self, key: str) -> _Nobody:
        """Of any key."""
        return self

    def put(self, message: Message | bytes) -> None:
        """Publish."""


class Harness:
    """Everything around the cycles; job manager and database can be torn down and opened again."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        settings: DispatcherSettings,
        solve: Solve | None,
        limits: JobLimits,
    ) -> None:
        self.settings, self.limits = settings, limits
        self.url = f"sqlite:///{folder}/cycles.db"
        self.records = ServiceRecords(folder / "service.db", seed, EVERYTHING, (0.0, 0.25))
        self._pool = None
        if solve is None:
            solve = self._pool = SolverPool(configured_solvers(settings))
            self._pool.warm_up()
        self.inner = Timed(solve)
        self.network = load_network("demo")
        self.fleet = load_fleet("demo", self.network)
        self._stack = ExitStack()
        self.open(warm=True)

    def open(self, *, warm: bool) -> None:
        """Database and job manager.

        Args:
            warm: whether to wait for the device's worker, so that the next cycles meet the device.
        """
        self.database = self._stack.enter_context(open_database(self.url))
        hardware = self.settings.hardware
        thread = JobThread(
            hardware,
            "hardware",
            FaultyServiceFactory(str(self.records.path)),
            AnsatzBuilder(LcQaoaSolver(self.settings.lc_qaoa)),
            self.database,
            self.limits,
            DAY_S,
        )
        manager = JobManager(self.inner, thread, hardware.wait_s, self.settings.deadline_s)
        self.manager = self._stack.enter_context(manager)
        self.outer = Timed(self.manager)
        if warm:
            thread.warm.wait(60.0)

    def run(self, number: int, traffic: TrafficSnapshot) -> CycleOutcome:
        """One cycle in some traffic, of a fleet that stands at its depots: nobody drives, and a
        vehicle that answers no plan would be left out of later ones.
        """
        now_ns = traffic.now_ns
        watch = FleetWatch(self.network, FleetRecords(), now_ns, lambda: now_ns, lambda _: None)
        runner = CycleRunner(
            self.settings,
            watch,
            PlanDelivery(_Nobody(), self.database, watch),
            Surroundings(
                lambda _: self.fleet,
                lambda _: traffic,
                lambda fleet: routing_problem(self.network, fleet, self.settings),
                self.outer,
            ),
        )
        self.manager.begin_cycle(number)
        return runner.run(now_ns)

    def wait_for_pool(self) -> None:
        """Between cycles: a killed solver's successor gets time to start, as it has in service.

        A cycle here is shorter than importing Aer takes, and would kill each successor in turn.
        """
        if self.inner.late and self._pool is not None:
            self._pool.warm_up(30.0)

    def close_device(self) -> None:
        """Close as in a crash: nothing is finished or reported."""
        self._stack.close()

    def close(self) -> None:
        """All of it."""
        self.close_device()
        if self._pool is not None:
            self._pool.close()


def run(
    cycles: int,
    seed: int,
    folder: Path,
    *,
    settings: DispatcherSettings = SETTINGS,
    limits: JobLimits = LIMITS,
    solve: Solve | None = None,
    restart_every: int = 40,
    write: Callable[[Mapping[str, Any]], object] = lambda _: None,
    checked: bool = True,
) -> Run:
    """Run cycles to the end, in this process.

    Args:
        folder: for database and service; what they hold from before goes on.
        solve: in place of a pool of the settings' solvers.
        restart_every: cycles between two restarts, on average.
        write: called with the record of each finished cycle.
        checked: whether to hold the ledger against the service's records in the end.
    """
    result = empty_run(settings)
    # It and multiprocessing's resource tracker stay when all workers have ended.
    start_fork_server()
    before = _resources()
    harness = Harness(folder, seed, settings, solve, limits)
    early = before
    first = harness.database.next_cycle_number()
    rng = random.Random(f"{seed} {first}")
    try:
        for number in range(first, first + cycles):
            entry = _cycle(harness, number, rng)
            if restarts := rng.random() * restart_every < 1:
                harness.close_device()
                harness.open(warm=rng.random() < 0.5)
            entry["restarted"] = int(restarts)
            result.add(entry)
            write(entry)
            if result.cycles == min(20, cycles):
                early = _resources()
        _settle(harness, result)
        late = _resources()
    finally:
        harness.close()
    if checked:
        check_run(harness.records, harness.url, result)
    after = _resources()
    result.growth = {name: late[name] - early[name] for name in early}
    result.leaks = {name: after[name] - before[name] for name in before}
    # A worker may just be replaced.
    for name, most in (("threads", 2), ("processes", 1), ("descriptors", 6)):
        for what, figures in (("in the run", result.growth), ("after it", result.leaks)):
            if figures[name] > most:
                result.broken.append(f"{figures[name]} more {name} {what}")
    return result


def empty_run(settings: DispatcherSettings) -> Run:
    """Of no cycles yet."""
    return Run(budget_s=settings.hardware.budget_s_per_day, limit_s=settings.deadline_s)


def _kill_worker(path: Path, killed: list[int]) -> None:
    """Kill the device's worker, and write down which, if it is still there."""
    with suppress(OSError, ValueError, psutil.Error):
        worker = psutil.Process(int(pid_file(path).read_text(encoding="utf-8")))
        if worker in psutil.Process().children(recursive=True):
            worker.send_signal(signal.SIGKILL)
            killed.append(worker.pid)


def _cycle(harness: Harness, number: int, rng: random.Random) -> dict[str, Any]:
    """Run a cycle; its record."""
    broken = []
    snapshot = _traffic(harness.network, rng)
    kills, after_s = rng.random() * KILL_WORKER_EVERY < 1, rng.uniform(0.0, 0.5)
    killed: list[int] = []
    killer = threading.Timer(after_s, _kill_worker, (harness.records.path, killed))
    if kills:
        killer.start()
    began = time.monotonic()
    outcome = harness.run(number, snapshot)
    done = outcome.planned
    wall_s = time.monotonic() - began
    settings, pool_s, solved_s = harness.settings, harness.inner.wall_s, harness.outer.wall_s
    may_wait_s = min(pool_s + settings.hardware.wait_s, (1 - RESERVE) * settings.deadline_s)
    beyond_s = solved_s - max(pool_s, may_wait_s)
    if wall_s > settings.deadline_s:
        broken.append(
            f"cycle {number} took {wall_s:.2f} s, {solved_s:.2f} s of it to solve, "
            f"the pool {pool_s:.2f} s"
        )
    if not done.plans:
        broken.append(f"cycle {number} made no plan: {done.report.reason}")
    if outcome.stored is None:
        broken.append(f"cycle {number} was not stored")
    faults = verify_plans(
        done.plans,
        harness.network,
        harness.fleet,
        {name for name, traffic in snapshot.segments.items() if traffic.open},
        settings.sync_window_s,
        unserved={},
        reference_s=settings.deadline_s,
    )
    broken += [f"cycle {number}: {fault}" for fault in faults]
    if kills:
        killer.join()
    harness.wait_for_pool()
    (chain,) = (run for run in done.report.solvers if run.solver == "lc-qaoa")
    fallback = None
    if chain.backend_kind != "hardware":
        why = chain.fallback or chain.reason or ""
        if not why:
            broken.append(f"cycle {number} does not say why the device has not answered")
        fallback = _kind_of(why)
    return {
        "cycle": number,
        "answered": chain.backend_kind or f"none: {chain.status}",
        "fallback": fallback,
        "wall_s": wall_s,
        "beyond_s": max(0.0, beyond_s),
        "worker_killed": len(killed),
        "broken": broken,
    }


def _traffic(network: RoadNetwork, rng: random.Random) -> TrafficSnapshot:
    """Gates open and close, speeds go up and down: now and then other arcs are candidates."""
    seen = {}
    for name in ("avenue_east", "avenue_west"):
        limit = network.segments[name].speed_limit_mps
        calm = rng.random() < 0.7
        speed = limit * (rng.choice((0.9, 1.0)) if calm else rng.choice((0.3, 0.5)))
        seen[name] = SegmentTraffic(
            name, speed, y_e=1 if calm else 0, open=calm, reason=None, age_s=1.0
        )
    segments = {s: SegmentTraffic(s, r.speed_limit_mps) for s, r in network.segments.items()}
    return TrafficSnapshot(time.time_ns(), segments | seen, ())


def _settle(harness: Harness, result: Run) -> None:
    """Without new faults all jobs must end by themselves."""
    harness.records.expect({})
    until = time.monotonic() + harness.limits.job_timeout_s + harness.limits.lost_after_s + 20.0
    while harness.manager.health().pending and time.monotonic() < until:
        time.sleep(0.1)
    if harness.manager.health().pending:
        result.broken.append(f"{harness.manager.health().pending} jobs never ended")


def _kind_of(why: str) -> str:
    """A reason without its figures and names."""
    words = ("#" if any(c.isdigit() for c in word) else word for word in why.split())
    return " ".join(words)[:90]


def _resources() -> dict[str, int]:
    process = psutil.Process()
    return {
        "threads": threading.active_count(),
        "processes": len(process.children(recursive=True)),
        "descriptors": process.num_fds(),
    }
