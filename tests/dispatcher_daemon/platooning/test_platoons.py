from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.plans.energy import route_energy, summarise
from dispatcher_daemon.platooning.platoons import Place, form_platoons
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.routes import Leg, Route, StopVisit
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.drive import DrivingStyle, plan_drive

AVENUE = "avenue_east"


def pass_over(vehicle: str, depart_s: float, speed_mps: float = 16.67) -> Route:
    """A route of one leg over gate_east and avenue_east."""
    drive = plan_drive([674.7, 1995.8], [13.89, speed_mps], DrivingStyle())
    leg = Leg("depot", "x", ("gate_east", AVENUE), 0.0, drive)
    visits = (StopVisit("depot", depart_s, depart_s), StopVisit("x", depart_s + 1, depart_s + 1))
    return Route(vehicle, visits, (leg,))


def places(
    routes: list[Route], snapshot: TrafficSnapshot, window_s: float = 3.0
) -> dict[str, Place]:
    """Place by vehicle on the avenue."""
    found = form_platoons(routes, snapshot, window_s, cycle=7)
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
    found = form_platoons(routes, traffic(avenue_east=1), 3.0, 1)
    leader, follower = (route_energy(demo, route, found) for route in routes)
    saved_leader = leader.undrafted.total_kwh - leader.driven.total_kwh
    saved_follower = follower.undrafted.total_kwh - follower.driven.total_kwh
    assert saved_follower == pytest.approx(4 * saved_leader, rel=0.01)
    assert leader.platooned_m == pytest.approx(1995.8, abs=1.0)

    alone = [route_energy(demo, route, {}) for route in routes]
    summary = summarise("alone", alone, [leader, follower], 2.0)
    assert summary.saved_distance_kwh == pytest.approx(0.0, abs=1e-12)
    assert summary.saved_acceleration_kwh == pytest.approx(0.0, abs=1e-12)
    assert summary.saved_drag_kwh == pytest.approx(saved_leader + saved_follower)
    assert summary.platooned_distance_m == pytest.approx(2 * 1995.8, abs=2.0)
