"""Vans with breaks: a plan is kept until the break is over, and no break is planned twice."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.traffic import TrafficSnapshot

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
    # By the clock it was this break; tomorrow's is another one.
    window_ns = first.issued_ns + 50 * S
    tracked.definition.__dict__["breaks"] = tuple(
        b.model_copy(update={"earliest_s": (window_ns - today.now_ns) / S})
        for b in tracked.definition.breaks
    )
    assert tracked.plannable(today.now_ns).breaks == ()
    assert len(tracked.plannable(today.now_ns + 86_400 * S).breaks) == 1
