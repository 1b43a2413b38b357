"""The one way of a cycle, with and without the running dispatcher around it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem, routing_problem
from dispatcher_daemon.service.dispatcher import CycleRunner, PlanDelivery, Surroundings
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot, traffic_by
from slipstream.messages import SegmentState, VehiclePlan
from slipstream.orders import FleetRecords
from tests.dispatcher_daemon.service.logged import SETTINGS, Log, feed, make

State = Callable[..., SegmentState]
NOW_NS = 1_700_000_000 * 10**9


def alone(demo: RoutingProblem, log: Log, traffic: Callable[[int], TrafficSnapshot]) -> CycleRunner:
    """A runner with neither daemon nor clock around it."""
    network = demo.network
    watch = FleetWatch(network, FleetRecords(), NOW_NS, lambda: NOW_NS, print)
    around = Surroundings(
        lambda _: demo.fleet,
        traffic,
        lambda fleet: routing_problem(network, fleet, SETTINGS),
        solve_in_process([ExactSolver()]),
    )
    return CycleRunner(SETTINGS, watch, PlanDelivery(log, log, watch), around)


def test_it_makes_the_running_dispatchers_plans(
    demo: RoutingProblem, state: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the same states at the same moment, by the same number and seed."""
    monkeypatch.setattr("time.time_ns", lambda: NOW_NS)
    states = [state("avenue_east", 1, time_ns=NOW_NS)]
    running, own = Log(), Log()
    dispatcher = make(demo, running)
    feed(dispatcher, state, "avenue_east", 1)
    dispatcher.run_cycle()
    runner = alone(demo, own, lambda now_ns: traffic_by(SETTINGS, demo.network, states, now_ns))
    outcome = runner.run(NOW_NS)
    assert outcome.stored is not None
    assert outcome.stored.status == "ok"
    assert own.published(VehiclePlan) == running.published(VehiclePlan) != []


def test_a_fault_of_planning_is_stored_and_handed_over(demo: RoutingProblem) -> None:
    """Who must not go on without plans sees it; the next cycle has the next number."""
    fault, log = RuntimeError("no roads"), Log()

    def fails(_: int) -> TrafficSnapshot:
        raise fault

    runner = alone(demo, log, fails)
    for number in (7, 8):
        outcome = runner.run(NOW_NS)
        assert outcome.error is fault
        assert outcome.stored is not None
        assert (outcome.stored.cycle, outcome.stored.status) == (number, "failed")
        assert outcome.stored.reason == "RuntimeError: no roads"
