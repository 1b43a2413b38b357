from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.plans.energy import route_energy, summarise
from dispatcher_daemon.planning.platooning.platoons import Place, form_platoons
from dispatcher_daemon.planning.roads.routes import RoadLeg, Route, StopVisit
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.drive import DrivingStyle, plan_drive

AVENUE = "avenue_east"


def pass_over(vehicle: str, depart_s: float, speed_mps: float = 16.67) -> Route:
    """A route of one leg over gate_east and avenue_east."""
    drive = plan_drive([674.7, 1995.8], [13.89, speed_mps], DrivingStyle())
    leg = RoadLeg("depot", "x", ("gate_east", AVENUE), 0.0, drive)
    visits = (StopVisit("depot", depart_s, depart_s), StopVisit("x", depart_s + 1, depart_s + 1))
    return Route(vehicle, visits, (leg,))


def places(
    routes: list[Route], snapshot: TrafficSnapshot, window_s: float = 3.0, longest: int = 8
) -> dict[str, Place]:
    """Place by vehicle on the avenue."""
    found = form_platoons(routes, snapshot, window_s, longest, cycle=7)
    assert all((leg, position) == (0, 1) for _, leg, position in found)
    return {vehicle: place for (vehicle, _, _), place in found.items()}


def test_first_in_leads_and_the_others_follow_in_order(
    traffic: Callable[..., TrafficSnapshot],
) -> None:
    """Three within the window after the first are one platoon; a fourth, later, is alone."""
    routes = [pass_over(v, t) for v, t in (("b", 1.0), ("a", 2.5), ("c", 0.0), ("d", 3.5))]
    found = places(routes, traffic(avenue_east=1))
    assert {v: p.number for v, p in found.items()} == {"c": 0, "b": 1, "a": 2}
    assert {p.platoon for p in found.values()} == {"c7-p1"}
    assert {p.members for p in found.values()} == {3}


def test_whom_a_full_platoon_has_no_place_for_leads_the_next_one(
    traffic: Callable[..., TrafficSnapshot],
) -> None:
    """Seven together, three a platoon at most: two full ones, and the last vehicle alone."""
    routes = [pass_over(f"van-{n}", 0.25 * n) for n in range(7)]
    found = places(routes, traffic(avenue_east=1), longest=3)
    assert [(found[f"van-{n}"].platoon, found[f"van-{n}"].number) for n in range(6)] == [
        *(("c7-p1", number) for number in range(3)),
        *(("c7-p2", number) for number in range(3)),
    ]
    assert {place.members for place in found.values()} == {3}
    assert "van-6" not in found


@pytest.mark.parametrize("y_e", [0, None])
def test_closed_gates_have_no_platoons(
    traffic: Callable[..., TrafficSnapshot], y_e: int | None
) -> None:
    """Turbulent or unknown: everybody drives alone."""
    assert places([pass_over("a", 0.0), pass_over("b", 1.0)], traffic(avenue_east=y_e)) == {}


def test_who_cannot_keep_up_is_no_follower(traffic: Callable[..., TrafficSnapshot]) -> None:
    """Entering together is not enough if one is due to leave the segment much later."""
    routes = [pass_over("a", 0.0), pass_over("b", 1.0, speed_mps=10.0)]
    assert places(routes, traffic(avenue_east=1)) == {}


def test_drafting_is_credited_to_leader_and_follower_and_the_parts_add_up(
    demo: RoutingProblem, traffic: Callable[..., TrafficSnapshot]
) -> None:
    """A follower saves about four times what its leader does, and drag is all that differs."""
    routes = [pass_over("van-a", 0.0), pass_over("van-b", 1.0)]
    found = form_platoons(routes, traffic(avenue_east=1), 3.0, 8, 1)
    leader, follower = (route_energy(demo, route, found) for route in routes)
    saved_leader = leader.undrafted.total_kwh - leader.driven.total_kwh
    saved_follower = follower.undrafted.total_kwh - follower.driven.total_kwh
    assert saved_follower == pytest.approx(4 * saved_leader, rel=0.01)
    assert leader.platooned_m == pytest.approx(1995.8, abs=1.0)
    # Of the version that knew no law but the paper's.
    found_kwh = [e.driven.total_kwh for e in (leader, follower)]
    assert found_kwh == pytest.approx([0.33815221259972716, 0.3271404459201009], rel=1e-13)

    alone = [route_energy(demo, route, {}) for route in routes]
    summary = summarise("alone", alone, [leader, follower], 2.0)
    assert summary.saved_distance_kwh == pytest.approx(0.0, abs=1e-12)
    assert summary.saved_acceleration_kwh == pytest.approx(0.0, abs=1e-12)
    assert summary.saved_drag_kwh == pytest.approx(saved_leader + saved_follower)
    assert summary.platooned_distance_m == pytest.approx(2 * 1995.8, abs=2.0)


@pytest.mark.parametrize("kinds", [("van",), ("truck_40t",), ("truck_40t", "van", None)])
@pytest.mark.parametrize("members", [2, 3, 4])
def test_meetings_and_energies_agree(
    town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]],
    kinds: tuple[str | None, ...],
    members: int,
) -> None:
    """On a segment that is driven at its planning speed, a platoon of any types saves in the
    planner's sum what it saves in the energy of the plans.
    """
    vehicles = [{"type": kinds[n % len(kinds)]} for n in range(members)]
    problem, snapshot = town(["33"], vehicles)
    path = ["00-10", "10-20", "20-30"]
    roads = [problem.network.segments[name] for name in path]
    seen = {name: replace(snapshot.segments[name], speed_mps=8.0) for name in path}
    snapshot = replace(snapshot, segments={**snapshot.segments, **seen})
    drive = plan_drive([r.length_m for r in roads], [8.0] * 3, DrivingStyle())
    leg = RoadLeg("depot-0", "s0", tuple(path), 0.0, drive)
    routes = [
        Route(f"van-{n}", (StopVisit("depot-0", at, at), StopVisit("s0", at + 1, at + 1)), (leg,))
        for n, at in enumerate(0.5 * n for n in range(members))
    ]
    meetings = Planner(problem, snapshot, [], 3.0).book.meetings()
    steady = path[1]
    begin_s, end_s = drive.entry_s[1:3]
    planned_kwh = sum(
        meetings.add({steady: [(begin_s + 0.5 * n, end_s + 0.5 * n, (n,))]}) for n in range(members)
    )
    found = form_platoons(routes, snapshot, 3.0, problem.longest_platoon, 1)
    there = {passage: place for passage, place in found.items() if passage[2] == 1}
    assert len(there) == members - (members % problem.longest_platoon == 1)
    energies = [route_energy(problem, route, there) for route in routes]
    saved_kwh = sum(e.undrafted.total_kwh - e.driven.total_kwh for e in energies)
    assert saved_kwh == pytest.approx(planned_kwh, rel=1e-9)
