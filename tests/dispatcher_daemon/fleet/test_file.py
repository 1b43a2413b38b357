"""A fleet's file may change while the dispatcher runs: each cycle dispatches what it says then."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from dispatcher_daemon.fleet.file import FleetFile
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.errors import InputError
from slipstream.messages import CycleReport, VehiclePlan
from tests.dispatcher_daemon.service.test_daemon import Log

SETTINGS = DispatcherSettings(solvers=("exact",))


def _write(path: Path, vehicles: list[str], stops: list[str]) -> None:
    """Write a fleet as an order system should: whole, under its name at once."""
    fleet = {
        "depots": [{"id": "depot", "node": "depot"}],
        "vehicles": [{"id": name} for name in vehicles],
        "stops": [{"id": name, "node": name} for name in stops],
    }
    new = path.with_suffix(".new")
    new.write_text(json.dumps(fleet))
    os.replace(new, path)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A fleet file of one van and one stop."""
    path = tmp_path / "fleet.json"
    _write(path, ["van-1"], ["c1"])
    return path


def _dispatcher(demo: RoutingProblem, path: Path) -> tuple[Dispatcher, Log]:
    fleet_file = FleetFile(str(path), demo.network)
    fleet, log = fleet_file.current(), Log()
    solve = solve_in_process([ExactSolver()])
    return Dispatcher(SETTINGS, demo.network, fleet, log, log, solve, fleet_file=fleet_file), log


def test_new_orders_and_vehicles_are_dispatched(demo: RoutingProblem, path: Path) -> None:
    """A stop and a van that came after the start get their plan in the next cycle."""
    dispatcher, log = _dispatcher(demo, path)
    dispatcher.run_cycle()
    _write(path, ["van-2"], ["c2", "c3"])
    dispatcher.run_cycle()
    first, second = log.published(VehiclePlan)
    assert isinstance(first, VehiclePlan)
    assert isinstance(second, VehiclePlan)
    assert (first.vehicle, [s.stop for s in first.stops]) == ("van-1", ["depot", "c1", "depot"])
    assert second.vehicle == "van-2"
    assert {stop.stop for stop in second.stops} == {"depot", "c2", "c3"}


@pytest.mark.parametrize("begins_so", [False, True])
@pytest.mark.parametrize(("vehicles", "stops"), [([], ["c1"]), (["van-1"], [])])
def test_nothing_to_dispatch_is_no_fault(
    demo: RoutingProblem, path: Path, vehicles: list[str], stops: list[str], begins_so: bool
) -> None:
    """Without a stop or a vehicle, at the start or later, a cycle says so; orders may come."""
    if begins_so:
        _write(path, vehicles, stops)
    dispatcher, log = _dispatcher(demo, path)
    _write(path, vehicles, stops)
    dispatcher.run_cycle()
    (report,) = log.published(CycleReport)
    assert isinstance(report, CycleReport)
    assert (report.status, report.plans) == ("ok", 0)
    assert report.reason == "no open order, or no free vehicle"
    _write(path, ["van-1"], ["c2"])
    dispatcher.run_cycle()
    assert len(log.published(VehiclePlan)) == 1


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "No such file"),
        ("{", "not JSON"),
        ('{"depots": [], "stops": [{"id": "x"}], "vehicles": [{"id": "v"}]}', "depots"),
    ],
)
def test_orders_that_may_be_served_are_not_dispatched_again(
    demo: RoutingProblem, path: Path, content: str | None, problem: str
) -> None:
    """While the file is gone or faulty cycles fail with its line; the next good one is taken."""
    dispatcher, log = _dispatcher(demo, path)
    path.unlink() if content is None else path.write_text(content)
    dispatcher.run_cycle()
    (report,) = log.published(CycleReport)
    assert isinstance(report, CycleReport)
    assert report.status == "failed"
    assert problem in str(report.reason)
    assert log.published(VehiclePlan) == []
    _write(path, ["van-1"], ["c2"])
    dispatcher.run_cycle()
    assert len(log.published(VehiclePlan)) == 1


def test_the_demo_and_an_unchanged_file_are_not_read_again(
    demo: RoutingProblem, path: Path
) -> None:
    """The same fleet comes back while the file is the same."""
    fleet_file = FleetFile(str(path), demo.network)
    assert fleet_file.current() is fleet_file.current()
    assert FleetFile("demo", demo.network).current() == demo.fleet
    with pytest.raises(InputError, match="no such file"):
        FleetFile(str(path.with_name("none.json")), demo.network)
