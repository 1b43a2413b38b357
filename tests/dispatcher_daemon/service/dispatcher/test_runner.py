"""The one way of a cycle, with and without the running dispatcher around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.tracking import idle_text
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


def test_what_keeps_idle_vehicles_is_told_of_each_order(demo: RoutingProblem) -> None:
    """A cycle that leaves orders and vehicles over is no plain "ok"."""
    stops = tuple(s.model_copy(update={"latest_s": 1.0}) for s in demo.fleet.stops)
    hurried = replace(demo, fleet=Fleet(**demo.fleet.parts | {"stops": stops}))
    runner = alone(hurried, Log(), lambda now_ns: traffic_by(SETTINGS, demo.network, [], now_ns))
    report = runner.run(NOW_NS).planned.report
    assert {one.stop for one in report.unserved} == {stop.id for stop in stops}
    for one in report.unserved:
        _, _, told = one.reason.partition("; idle: ")
        assert all(vehicle.id in told for vehicle in demo.fleet.vehicles), one.reason
        assert "there at" in told


def test_vehicles_with_the_same_obstacle_stand_together() -> None:
    """However many there are, the text stays short."""
    assert idle_text({}) == ""
    some = idle_text({"a": "silent", "b": "lacks cold", "c": "silent"})
    assert some == "; idle: a, c: silent; b: lacks cold"
    many = idle_text({f"v{n}": f"there at {n % 9} s" for n in range(900)})
    assert many.count("and 95 more: there at") == 5
    assert many.endswith("; 400 more: other reasons")
