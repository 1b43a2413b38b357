"""Vans with breaks: a plan is kept until the break is over, and no break is planned twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from dispatcher_daemon.fleet import Depot, Vehicle
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle, loaded
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

from .fleet_drive import Day, S, Van


@pytest.mark.slow
def test_a_van_has_its_break_once(
    town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]],
) -> None:
    """Its plan stays until then, cycles after it go on from where it is; a new dispatcher knows."""
    stops = [
        {"id": f"s{i}", "node": n, "service_s": 20.0} for i, n in enumerate(("11", "22", "33"))
    ]
    pause = {"duration_s": 60.0, "earliest_s": 50.0, "latest_s": 150.0}
    problem, snapshot = town(stops, [{"breaks": [pause]}])
    (name,) = (vehicle.id for vehicle in problem.fleet.vehicles)
    van = Van(name, "00-01")
    today = Day(problem, snapshot, {name: van}, problem.fleet)
    today.drive(2)
    today.run(1)
    (first,) = van.plans
    (stop,) = (s for s in first.stops if s.kind == "break")
    while today.now_ns < stop.departure_ns:
        assert van.plans == [first]
        today.run(1)
    today.restart()
    today.drive(3)
    for _ in range(30):
        if van.plan is None:
            break
        today.run(1)
    today.run(1)
    assert today.states() == {"served": 3}
    assert all(s.kind != "break" for plan in van.plans[1:] for s in plan.stops)
    tracked = today.tracker.vehicles[name]
    assert stop.departure_ns <= tracked.rested_ns <= stop.departure_ns + 60 * S
    assert tracked.rested_break == 0
    # By the clock it was this break; tomorrow's is another one.
    window_ns = first.issued_ns + 50 * S
    tracked.definition.__dict__["breaks"] = tuple(
        b.model_copy(update={"earliest_s": (window_ns - today.now_ns) / S})
        for b in tracked.definition.breaks
    )
    (own,) = tracked.definition.breaks
    assert tracked.plannable(today.now_ns).breaks == (own.over,)
    assert tracked.plannable(today.now_ns + 86_400 * S).breaks == (own,)


@pytest.mark.parametrize(
    ("last", "over"), [(0, [True, False]), (1, [True, True]), (None, [True, True])]
)
def test_of_two_breaks_in_one_window_each_is_had_once(last: int | None, over: list[bool]) -> None:
    """The end of the first one is inside the second one's window, and says nothing of that; a
    vehicle of a version before, which told only the end, had both.
    """
    window = {"duration_s": 60.0, "earliest_s": -600.0, "latest_s": 600.0}
    vehicle = Vehicle.model_validate({"id": "van", "breaks": [window, window]})
    tracked = TrackedVehicle(vehicle, Depot(id="d", node="00"), rested_ns=10**18)
    tracked = loaded(replace(tracked, rested_break=last).record())
    due = tracked.plannable(10**18).breaks
    assert [own == own.over for own in due] == over
    assert tracked.plannable(10**18 + 86_400 * S).breaks == vehicle.breaks


def test_the_time_of_a_tour_is_no_break_at_the_depot() -> None:
    """Back in the middle of the window, a vehicle has its break from then on, on its next tour or
    before it; where it came back after the window, that is over.
    """
    window = {"duration_s": 600.0, "earliest_s": -1200.0, "latest_s": 1200.0}
    vehicle = Vehicle.model_validate({"id": "van", "breaks": [window]})
    now_ns = 10**18
    tracked = TrackedVehicle(vehicle, Depot(id="d", node="00"), back_ns=now_ns - 60 * S)
    back = tracked.plannable(now_ns)
    assert vehicle.breaks_at_depot(100.0, 5000.0) == {0}
    assert back.breaks_at_depot(100.0, 5000.0) == set()
    assert back.breaks_at_depot(540.0, 5000.0) == {0}
    assert tracked.plannable(now_ns - 3600 * S).breaks == vehicle.breaks
