"""Routing by what each vehicle's class and size may use."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.plans.verify import verify_plans
from dispatcher_daemon.planning.roads import fleet_travel
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.roads.access import ALL_CLASSES, Access

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
NO_TRAILER = Access(classes=ALL_CLASSES - {"trailer"})


def restricted(
    problem: RoutingProblem,
    access: dict[str, Access],
    turns: dict[tuple[str, str], frozenset[str]] | None = None,
    **fleet: Any,
) -> RoutingProblem:
    """The same with restrictions on some segments and turns, and changes of the fleet."""
    network = problem.network
    segments = {
        name: replace(segment, access=access.get(name, segment.access))
        for name, segment in network.segments.items()
    }
    return replace(
        problem,
        network=replace(network, segments=segments, turn_classes=turns or {}),
        fleet=Fleet.model_validate(problem.fleet.model_dump() | fleet),
    )


def dispatched(problem: RoutingProblem, snapshot: TrafficSnapshot) -> CycleResult:
    """One cycle in route form."""
    settings = DispatcherSettings(form="route", interval_s=2000.0, deadline_s=1000.0)
    cycle = Cycle(problem, snapshot, settings, 1, 0, 1, 10.0)
    with ThreadPoolExecutor(1) as thread:
        return run_cycle(cycle, solve_in_process([ExactSolver()]), thread)


def path(problem: RoutingProblem, snapshot: TrafficSnapshot, number: int) -> tuple[str, ...] | None:
    """A vehicle's way to the first stop."""
    travel = fleet_travel(problem, snapshot).of(problem.fleet.vehicles[number])
    leg = travel.leg("depot-0", "s0")
    return None if leg is None else leg.path


MIXED = [{"id": "car"}, {"id": "truck", "type": "truck_40t"}]


def test_each_class_goes_by_what_it_may_use(town: Town) -> None:
    """The car keeps its way; the truck goes round the segment or the turn that is closed to it."""
    problem, snapshot = town(["22"], MIXED)
    open_way = path(problem, snapshot, 0)
    assert open_way is not None
    closed = restricted(problem, {open_way[1]: NO_TRAILER})
    assert path(closed, snapshot, 0) == open_way
    detour = path(closed, snapshot, 1)
    assert detour is not None
    assert open_way[1] not in detour
    turn = restricted(problem, {}, {(open_way[0], open_way[1]): frozenset({"passenger"})})
    assert path(turn, snapshot, 0) == open_way
    other = path(turn, snapshot, 1)
    assert other is not None
    assert open_way[:2] != other[:2]


def test_low_bridges_and_weak_roads_are_for_what_fits(town: Town) -> None:
    """By the heights and masses of the types."""
    problem, snapshot = town(["22"], MIXED)
    truck_way = path(problem, snapshot, 1)
    assert truck_way is not None
    for limit in (Access(max_height_m=3.9), Access(max_mass_kg=38000.0)):
        assert truck_way[0] not in (
            path(restricted(problem, {truck_way[0]: limit}), snapshot, 1) or ()
        )
    enough = Access(max_height_m=4.0, max_mass_kg=40000.0)
    assert path(restricted(problem, {truck_way[0]: enough}), snapshot, 1) == truck_way


def test_a_stop_that_a_class_cannot_reach_is_another_vehicles_or_named(town: Town) -> None:
    """The truck's neighbour serves it; without one, it is unserved with the class that counts."""
    problem, snapshot = town(["33", "01"], MIXED)
    into = [s for s in problem.network.segments.values() if s.end == "33"]
    closed = restricted(problem, {s.id: NO_TRAILER for s in into})
    result = dispatched(closed, snapshot)
    by_stop = {s.stop: plan.vehicle for plan in result.plans for s in plan.stops[1:-1]}
    assert by_stop["s0"] == "car"
    assert result.report.unserved == ()
    alone = restricted(closed, {s.id: NO_TRAILER for s in into}, vehicles=[MIXED[1]])
    result = dispatched(alone, snapshot)
    assert [u.stop for u in result.report.unserved] == ["s0"]
    assert "by roads that 'truck' (trailer) may use" in result.report.unserved[0].reason


def test_a_class_keeps_to_its_own_speed_limit(town: Town) -> None:
    """In its times, its advised speeds and what its plan says of the road."""
    problem, snapshot = town(["33"], [MIXED[1]])
    slow = Access(class_speeds_mps={"trailer": 5.0})
    result = dispatched(
        restricted(problem, dict.fromkeys(problem.network.segments, slow)), snapshot
    )
    (plan,) = result.plans
    assert plan.segments
    for segment in plan.segments:
        assert segment.speed_mps <= 5.0
        assert segment.speed_limit_mps == 5.0
    with_car = restricted(problem, {}, vehicles=[MIXED[0]])
    assert dispatched(with_car, snapshot).plans[0].segments[0].speed_limit_mps != 5.0


@pytest.mark.parametrize("kind", ["segment", "turn", "speed"])
def test_the_verifier_refuses_what_a_class_may_not(town: Town, kind: str) -> None:
    """Whoever planned it."""
    problem, snapshot = town(["33"], [MIXED[1]])
    (plan,) = dispatched(problem, snapshot).plans
    a, b = plan.segments[0].segment, plan.segments[1].segment
    closed = {
        "segment": restricted(problem, {b: NO_TRAILER}),
        "turn": restricted(problem, {}, {(a, b): frozenset({"passenger"})}),
        "speed": restricted(problem, {b: Access(class_speeds_mps={"trailer": 5.0})}),
    }[kind]
    fault = {
        "segment": f"truck: may not use {b}",
        "turn": f"truck: may not turn from {a} into {b}",
        "speed": f"truck: faster than allowed on {b}",
    }[kind]

    def faults(of: RoutingProblem) -> tuple[str, ...]:
        return verify_plans([plan], of.network, of.fleet, (), 3.0, reference_s=10.0)

    assert faults(problem) == ()
    assert fault in faults(closed)
