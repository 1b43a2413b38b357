"""Arms on real workers of a cluster: the same results, also where a worker is killed."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from slipstream_lab.simulation.closed_loop.arm import ArmSpec, run_arm
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.evaluation.runs.cluster import arms_on, simulate_sent
from slipstream_lab.simulation.scenarios.scenario import load_scenario, prepare
from tests.dispatcher_daemon.solvers.cluster.conftest import Members, wait_until

SPAN_S = (36000.0, 36900.0)


@pytest.fixture(scope="module")
def order(tmp_path_factory: pytest.TempPathFactory) -> ArmSpec:
    """A quarter of an hour of Troy at ten o'clock."""
    background = prepare(load_scenario("troy"), 1, tmp_path_factory.mktemp("arm"))
    begin_s, end_s = SPAN_S
    return ArmSpec(
        "troy",
        background.files,
        background.rsus,
        1,
        Policy("C", frozenset({"platoons"})),
        begin_s=begin_s,
        end_s=end_s,
    )


@pytest.fixture
def two_workers(tmp_path: Path) -> Iterator[Members]:
    """A scheduler and two workers of one process each."""
    members = Members(tmp_path)
    try:
        members.start_scheduler()
        members.start_worker()
        members.start_worker()
        yield members
    finally:
        members.end()


@pytest.mark.nightly
@pytest.mark.process
def test_a_killed_worker_costs_time_and_changes_no_result(
    order: ArmSpec, two_workers: Members
) -> None:
    """Two arms at once; the worker that is killed meanwhile has its arm done by the other one."""
    expected = run_arm(order, None)
    told = threading.Event()
    with arms_on(two_workers.settings) as arms, ThreadPoolExecutor(2) as threads:
        wait_until(lambda: arms.processes == 2)
        both = [threads.submit(arms.run, order, lambda *_: told.set()) for _ in range(2)]
        assert told.wait(60)
        two_workers.kill_worker()
        assert [future.result(300) for future in both] == [expected, expected]


@pytest.mark.long
def test_a_worker_with_other_sources_refuses(order: ArmSpec) -> None:
    """Its results would be those of another program."""
    with pytest.raises(ValueError, match="other sources is asked for"):
        simulate_sent("other sources", order, ())


@pytest.mark.process
@pytest.mark.long
def test_what_was_stopped_stops_waiting(order: ArmSpec, two_workers: Members) -> None:
    """What the progress callback raises ends the wait for an arm."""

    def stop(*_: float) -> None:
        raise KeyboardInterrupt

    with arms_on(two_workers.settings) as arms, pytest.raises(KeyboardInterrupt):
        arms.run(order, stop)
