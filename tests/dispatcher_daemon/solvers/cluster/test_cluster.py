from __future__ import annotations

import itertools
import logging
import math
import os
import random
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np
import psutil
import pytest

from dispatcher_daemon import metrics
from dispatcher_daemon.planning.cycle.solving import Solving
from dispatcher_daemon.planning.route_form import FleetPlan, plan_fleet
from dispatcher_daemon.settings import (
    CitySettings,
    ClusterSettings,
    DispatcherSettings,
    SearchSettings,
)
from dispatcher_daemon.solvers.cluster.calls import CallFailed
from dispatcher_daemon.solvers.cluster.client import Cluster
from dispatcher_daemon.solvers.cluster.fallback import (
    CLUSTER_SHARE,
    ClusterExecutor,
    cluster_solve,
)
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.workers.pool import (
    GRACE_S,
    PoolJob,
    Solve,
    solve_in_process,
)
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor
from slipstream_lab.research.cities.generator import CityShape, generate_city
from slipstream_lab.research.instances.forms import instance_cycle

from .conftest import READY_S, Members, wait_until

pytestmark = pytest.mark.process
Connect = Callable[[ClusterSettings, int], AbstractContextManager[Cluster]]

CITY = CitySettings(
    search=SearchSettings(
        rounds=3, iterations_per_stop=5, workers=2, part_stops=20, time_limit_s=200.0
    ),
    second_rounds=1,
    max_sweeps=4,
    patience=2,
    block_deadline_s=60.0,
)
TOWN = generate_city(
    1, vehicles=12, stops=60, segments=160, shape=CityShape(depots=1, open_share=0.9)
)
LOCAL = solve_in_process([ExactSolver()])


def plan(executor: Executor, solve: Solve, deadline_s: float) -> FleetPlan:
    """The town's plan of seed 1."""
    settings = DispatcherSettings(
        city=CITY, solvers=CITY.solvers, interval_s=1000.0, deadline_s=deadline_s
    )
    return plan_fleet(instance_cycle(TOWN, 1, settings), executor, solve)


def stops_of(made: FleetPlan) -> list[tuple[tuple[str, ...], float]]:
    """Stops and departure of each vehicle."""
    return [(i.stops, i.depart_s) for i in made.choice.itineraries]


@contextmanager
def own_processes(cluster: Cluster) -> Iterator[ClusterExecutor]:
    """The cluster with two processes of this machine behind it."""
    with ClusterExecutor(cluster, WorkerExecutor(2), 2) as executor:
        yield executor


@pytest.fixture(scope="module")
def expected() -> list[tuple[tuple[str, ...], float]]:
    """The plan of this process alone."""
    with ThreadPoolExecutor(1) as thread:
        return stops_of(plan(thread, LOCAL, 600.0))


def refuse(jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
    """A `Solve` that must not be asked."""
    raise AssertionError(f"{len(jobs)} jobs did not go to the cluster")


def at_call(cluster: Cluster, number: int, act: Callable[[], None]) -> None:
    """Act when the cluster has been sent so many calls, while it is at the last one."""
    submit, count = cluster.submit, itertools.count(1)

    def counted(*args: Any) -> Future[Any]:
        future = submit(*args)
        if next(count) == number:
            act()
        return future

    cluster.submit = counted  # type: ignore[method-assign]


@pytest.mark.long
def test_two_workers_plan_as_this_machine_does(
    members: Members, connected: Connect, expected: Any
) -> None:
    """The plan of one seed is the same, and workers compute all of it; a call that raises or takes
    too long is told, and an array goes to the cluster once.
    """
    members.start_worker()
    members.start_worker()
    with connected(members.settings, 2) as cluster, own_processes(cluster) as executor:
        made = plan(executor, cluster_solve(cluster, [ExactSolver()], refuse), 600.0)
        assert stops_of(made) == expected
        assert not made.timed_out
        with pytest.raises(CallFailed, match="ValueError: math domain error"):
            cluster.submit(math.sqrt, (-1.0,), 60.0, 60.0).result(90)
        with pytest.raises(TimeoutError, match=r"within 0\.5 s"):
            cluster.submit(time.sleep, (60.0,), 0.5, 60.0).result(90)
        array, before = np.arange(100_000.0), sent_bytes()
        for _ in range(3):
            assert cluster.submit(np.sum, (array,), 60.0, 60.0).result(90) == array.sum()
        assert array.nbytes < sent_bytes() - before < 1.1 * array.nbytes


@pytest.mark.nightly
@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("number", [1, 6])
def test_a_worker_killed_at_work_changes_no_plan(
    members: Members, connected: Connect, expected: Any, workers: int, number: int
) -> None:
    """What it was at is done by another worker or by this machine, and a new worker gets work."""
    for _ in range(workers):
        members.start_worker()
    with connected(members.settings, workers) as cluster, own_processes(cluster) as executor:
        at_call(cluster, number, members.kill_worker)
        made = plan(executor, cluster_solve(cluster, [ExactSolver()], LOCAL), 600.0)
        assert stops_of(made) == expected
        members.start_worker()
        assert cluster.wait_for(workers, READY_S)
        assert cluster.submit(math.hypot, (3.0, 4.0), 60.0, 60.0).result(90) == 5.0


def _lost(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [line for line in caplog.messages if "this machine solves" in line]


@pytest.mark.long
def test_a_killed_scheduler_changes_no_plan(
    members: Members, connected: Connect, expected: Any, caplog: pytest.LogCaptureFixture
) -> None:
    """This machine plans alone, says so once, and takes the cluster up when it is back."""
    caplog.set_level(logging.INFO)
    members.start_worker()
    with connected(members.settings, 1) as cluster, own_processes(cluster) as executor:
        solve = cluster_solve(cluster, [ExactSolver()], LOCAL)
        # A slow start of the scheduler is told too.
        caplog.clear()
        at_call(cluster, 2, members.kill_scheduler)
        for _ in range(2):
            assert stops_of(plan(executor, solve, 600.0)) == expected
        deadline = time.monotonic() + 60
        while not (lost := _lost(caplog)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert len(lost) == 1
        members.start_scheduler()
        assert cluster.wait_for(1, READY_S)
        assert stops_of(plan(executor, cluster_solve(cluster, [ExactSolver()], refuse), 600.0)) == (
            expected
        )


@pytest.mark.nightly
def test_a_silent_worker_costs_its_share_of_the_time(members: Members, connected: Connect) -> None:
    """A worker that stands still is waited for no longer than the cluster's share; then this
    machine answers, and the worker gets no work before it answers again.
    """
    members.start_worker()
    with connected(members.settings, 1) as cluster, own_processes(cluster) as executor:
        worker = psutil.Process(members.workers[0].pid)
        worker.suspend()
        try:
            began = time.monotonic()
            assert executor.submit_within(10.0, 10.0, pow, 2.0).result(60) > 1.0
            assert CLUSTER_SHARE * 10.0 <= time.monotonic() - began < 10.0 + GRACE_S
            assert cluster.slots == 0
        finally:
            worker.resume()
        assert cluster.wait_for(1, READY_S)


@pytest.mark.long
def test_a_worker_of_another_build_gets_no_work(
    members: Members, connected: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    """It is named in one line with both builds; a worker of this build beside it does the work."""
    members.start_worker(strange=True)
    members.start_worker()
    with connected(members.settings, 1) as cluster:

        def lines() -> list[str]:
            return [line for line in caplog.messages if "gets no work" in line]

        wait_until(lambda: bool(lines()))
        servers = {cluster.submit(os.getppid, (), 60.0, 60.0).result(90) for _ in range(5)}
        assert {psutil.Process(pid).ppid() for pid in servers} == {members.workers[1].pid}
        assert cluster.slots == 1
        assert len(lines()) == 1
        assert "it is slipstream 9.9.9, this is slipstream" in lines()[0]


@pytest.mark.long
@pytest.mark.parametrize("address", ["local", "tcp://127.0.0.1:1"])
def test_a_dispatcher_plans_by_its_setting(address: str, expected: Any) -> None:
    """By the settings' cluster if there is one; alone if nobody is at its address."""
    settings = DispatcherSettings(city=CITY, cluster=ClusterSettings(address=address))
    solvers, before = [ExactSolver()], answered()
    with Solving(settings, solvers, in_routes=True) as solving:
        solving.join_cluster()
        if address == "local":
            wait_until(lambda: metrics.CLUSTER_PROCESSES._value.get() == 2)
        assert stops_of(plan(solving.executor, solving.solve, 600.0)) == expected
        assert solving.slots is not None
        assert solving.slots() == (2 if address == "local" else 0)
    assert (answered() > before) == (address == "local")


@pytest.mark.nightly
@pytest.mark.attack
def test_every_cycle_is_on_time_while_workers_are_killed(
    members: Members, connected: Connect, full_size: bool, figure: Callable[[str], None]
) -> None:
    """In each cycle one of two workers is killed at a random call; another one is started."""
    cycles, deadline_s, rng = 100 if full_size else 20, 30.0, random.Random(1)
    for _ in range(2):
        members.start_worker()
    walls, plans = [], []
    with connected(members.settings, 2) as cluster, own_processes(cluster) as executor:
        submit = cluster.submit

        def replace_worker() -> None:
            members.kill_worker()
            members.start_worker()

        for _ in range(cycles):
            assert cluster.wait_for(1, READY_S)
            cluster.submit = submit  # type: ignore[method-assign]
            at_call(cluster, rng.randint(1, 8), replace_worker)
            began = time.monotonic()
            made = plan(executor, cluster_solve(cluster, [ExactSolver()], LOCAL), deadline_s)
            walls.append(time.monotonic() - began)
            plans.append(made.choice.objective_kwh)
    figure(f"{cycles} cycles, the longest took {max(walls):.1f} of {deadline_s:.0f} s")
    assert max(walls) <= deadline_s
    assert all(math.isfinite(objective) for objective in plans)


def answered() -> float:
    """Calls that workers have answered, by the metric."""
    return metrics.CLUSTER_CALLS.labels("value")._value.get()


def sent_bytes() -> float:
    """By the metric."""
    return metrics.CLUSTER_BYTES._value.get()
