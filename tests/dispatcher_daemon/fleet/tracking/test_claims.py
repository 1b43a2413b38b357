"""Who has served an order: its holder, by a plan, at its place. Nothing else ends one."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.fleet.tracking import at_risk
from dispatcher_daemon.fleet.tracking.sightings import LEEWAY_NS
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.alarms import fleet_conditions
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.messages import VehiclePlan, VehiclePosition, VehicleProgress, Visit

from .fleet_drive import Day, S, Van

Town = tuple[RoutingProblem, TrafficSnapshot]


@pytest.fixture
def today(town: Callable[..., Town]) -> Day:
    """Two vans that stand at their depot with plans of three orders each, acknowledged."""
    stops = [
        {"id": f"s{i}", "node": node, "service_s": 20.0, "demand": 1}
        for i, node in enumerate(("11", "22", "33", "30", "03", "21"))
    ]
    problem, snapshot = town(stops, [{"capacity": 3}, {"capacity": 3}])
    vans = {vehicle.id: Van(vehicle.id, "00-01") for vehicle in problem.fleet.vehicles}
    day = Day(problem, snapshot, vans, problem.fleet)
    day.drive(2)
    plans = day.cycle()
    for plan in plans:
        day.vans[plan.vehicle].offer(plan, day.now_ns)
    day.drive(1)
    return day


def says(
    day: Day,
    vehicle: str,
    *orders: str,
    status: str = "served",
    at_ns: int | None = None,
    cycle: int | None = None,
) -> None:
    """A vehicle says that it has ended orders."""
    when_ns = day.now_ns if at_ns is None else at_ns
    reason = "nobody there" if status == "failed" else None
    visits = tuple(
        Visit(stop=o, status=status, arrived_ns=when_ns, ended_ns=when_ns, reason=reason)  # type: ignore[arg-type]
        for o in orders
    )
    told = VehicleProgress(vehicle=vehicle, time_ns=day.now_ns, cycle=cycle, visits=visits)
    day.tracker.on_progress(told, day.now_ns)


def stands_at(day: Day, plan: VehiclePlan, order: str, after_s: float = 1.0) -> None:
    """A vehicle stands where an order of its plan is served."""
    day.now_ns += round(after_s * S)
    leg = [stop.stop for stop in plan.stops].index(order)
    into = [one.segment for one in plan.segments if one.leg == leg - 1][-1]
    place = {"segment": into, "share": 1.0, "speed_mps": 0.0, "on_road": False}
    own = {"vehicle": plan.vehicle, "time_ns": day.now_ns, "cycle": plan.cycle, "leg": leg}
    day.tracker.on_position(VehiclePosition.model_validate({**place, **own}), day.now_ns)


def states(day: Day, *orders: str) -> set[str]:
    """Of some orders."""
    return {day.tracker.book.orders[order].state for order in orders}


def disputes(day: Day) -> dict[str, str]:
    """Texts of the alarms of what does not count, by subject."""
    return {
        one.subject: one.text
        for one in fleet_conditions(day.tracker, {}, day.number + 1, day.now_ns)
        if one.kind == "service_disputed"
    }


def plans(day: Day) -> tuple[VehiclePlan, VehiclePlan]:
    """Those of the two vans, both with orders."""
    one, other = (van.plan for van in day.vans.values())
    assert one is not None
    assert other is not None
    return one, other


def served_by(plan: VehiclePlan) -> list[str]:
    """Orders of a plan."""
    return [stop.stop for stop in plan.service_stops]


@pytest.mark.parametrize("status", ["served", "failed"])
def test_an_order_of_another_vehicle_is_not_ended(today: Day, status: str) -> None:
    """Whoever says so: it stays its holder's, and an alarm names order, vehicle and reason."""
    one, other = plans(today)
    order = served_by(other)[0]
    today.tracker.book.pin(order, other.vehicle, today.now_ns)
    stands_at(today, one, served_by(one)[0])
    says(today, one.vehicle, order, status=status)
    known = today.tracker.book.orders[order]
    assert (known.state, known.vehicle) == ("planned", other.vehicle)
    text = disputes(today)[f"order/{order}"]
    assert one.vehicle in text
    assert f"pinned to {other.vehicle}" in text
    assert at_risk(known, today.tracker, today.now_ns) == text
    stands_at(today, other, order)
    says(today, other.vehicle, order)
    assert states(today, order) == {"served"}
    assert not disputes(today)


def test_one_message_does_not_close_many_orders(today: Day) -> None:
    """Neither its own from elsewhere nor those of others; beyond five one alarm has the rest."""
    one, other = plans(today)
    every = [*served_by(one), *served_by(other)]
    says(today, one.vehicle, *every, cycle=one.cycle)
    assert states(today, *every) == {"planned"}
    told = disputes(today)
    assert len(told) == 6
    assert "1 more order" in told[f"vehicle/{one.vehicle}"]


def test_its_holder_at_its_place_serves_an_order(today: Day) -> None:
    """In any order, a little before it is there or after it has gone; not long before or after."""
    plan, _ = plans(today)
    first, second, third = served_by(plan)
    stands_at(today, plan, second)
    says(today, plan.vehicle, second)
    assert states(today, second) == {"served"}
    says(today, plan.vehicle, first)
    assert states(today, first) == {"under_way"}
    assert f"order/{first}" in disputes(today)
    stands_at(today, plan, first, 10.0)
    assert states(today, first) == {"served"}
    assert not disputes(today)
    says(today, plan.vehicle, third, at_ns=today.now_ns)
    for _ in range(LEEWAY_NS // (10 * S) + 2):
        stands_at(today, plan, first, 10.0)
    stands_at(today, plan, third)
    assert states(today, third) == {"under_way"}
    says(today, plan.vehicle, third)
    assert states(today, third) == {"served"}


def test_a_service_that_nobody_saw_waits_until_its_vehicle_is_heard(today: Day) -> None:
    """Silent, it is not believed yet; heard again where it can be after it, it is."""
    plan, _ = plans(today)
    first, second, third = served_by(plan)
    stands_at(today, plan, first)
    today.now_ns += 60 * S
    says(today, plan.vehicle, second)
    assert states(today, second) == {"under_way"}
    assert "its place at that time is not known" in disputes(today)[f"order/{second}"]
    stands_at(today, plan, third, 60.0)
    assert states(today, second) == {"served"}
    assert states(today, third) == {"under_way"}


def test_a_plan_that_was_taken_back_is_remembered(today: Day) -> None:
    """Who served by it, and was there, has served; another holder that has not left loses it."""
    one, other = plans(today)
    order = served_by(one)[0]
    life = today.tracker.book
    life.release(one.vehicle, today.now_ns, "taken back")
    life.assign(order, other.vehicle, 2, today.now_ns)
    says(today, one.vehicle, order)
    assert states(today, order) == {"planned"}
    stands_at(today, one, order)
    known = life.orders[order]
    assert (known.state, known.vehicle) == ("served", one.vehicle)


def test_an_order_that_was_perhaps_served_is_nobody_elses_before_somebody_decides(
    today: Day,
) -> None:
    """Its van comes home without having been there: it stays under way until it is settled."""
    plan, _ = plans(today)
    van = today.vans[plan.vehicle]
    first = served_by(plan)[0]
    for order in served_by(plan)[1:]:
        stands_at(today, plan, order)
        says(today, plan.vehicle, order)
    says(today, plan.vehicle, first, at_ns=today.now_ns)
    today.now_ns += S
    home = {"segment": van.home, "share": 0.0, "speed_mps": 0.0, "on_road": False}
    own = {"vehicle": plan.vehicle, "time_ns": today.now_ns, "cycle": None, "leg": None}
    today.tracker.on_position(VehiclePosition.model_validate({**home, **own}), today.now_ns)
    says(today, plan.vehicle, first, at_ns=today.now_ns)
    assert today.tracker.vehicles[plan.vehicle].accepted is None
    assert states(today, first) == {"under_way"}
    today.tracker.settle(first, today.now_ns + S, served=False)
    assert states(today, first) == {"open"}
    says(today, plan.vehicle, first, at_ns=today.now_ns)
    assert not disputes(today)
    today.tracker.settle(first, today.now_ns, served=True)
    assert states(today, first) == {"served"}


def test_a_leg_that_is_claimed_serves_nothing_on_the_way(town: Callable[..., Town]) -> None:
    """Of a van that sends positions alone, a stop is served where it was near, not by a number."""
    stops = [{"id": "s0", "node": "33", "service_s": 20.0, "demand": 1}]
    problem, snapshot = town(stops, [{"capacity": 3}])
    van = Van("van-0", "00-01", talks=False)
    day = Day(problem, snapshot, {"van-0": van}, problem.fleet)
    day.drive(2)
    (plan,) = day.cycle()
    van.offer(plan, day.now_ns)
    day.drive(1)
    day.now_ns += S
    first = plan.segments[0].segment
    place = {"segment": first, "share": 0.5, "speed_mps": 9.0, "on_road": True}
    own = {"vehicle": "van-0", "time_ns": day.now_ns, "cycle": plan.cycle, "leg": 1}
    day.tracker.on_position(VehiclePosition.model_validate({**place, **own}), day.now_ns)
    assert states(day, "s0") == {"under_way"}
    stands_at(day, plan, "s0")
    day.now_ns += S
    back = next(one.segment for one in plan.segments if one.leg == 1)
    own |= {"time_ns": day.now_ns}
    position = VehiclePosition.model_validate({**place, **own, "segment": back})
    day.tracker.on_position(position, day.now_ns)
    assert states(day, "s0") == {"served"}


def test_a_vehicle_with_a_wrong_clock_serves_its_orders(town: Callable[..., Town]) -> None:
    """Visits and positions are of the same clock, however wrong that is."""
    stops = [{"id": "s0", "node": "33", "service_s": 20.0, "demand": 1}]
    problem, snapshot = town(stops, [{"capacity": 3}])
    for wrong_ns in (-3600 * S, 3600 * S):
        day = Day(problem, snapshot, {}, problem.fleet)
        day.tracker.list_fleet(problem.fleet, day.now_ns)
        place: dict[str, object] = {"vehicle": "van-0", "speed_mps": 0.0, "on_road": False}
        home = {**place, "segment": "00-01", "share": 0.0, "cycle": None, "leg": None}
        day.now_ns += S
        position = VehiclePosition.model_validate({**home, "time_ns": day.now_ns + wrong_ns})
        day.tracker.on_position(position, day.now_ns)
        (plan,) = day.cycle()
        into = [one.segment for one in plan.segments if one.leg == 0][-1]
        there = {**place, "segment": into, "share": 1.0, "cycle": plan.cycle, "leg": 1}
        day.now_ns += 60 * S
        position = VehiclePosition.model_validate({**there, "time_ns": day.now_ns + wrong_ns})
        day.tracker.on_position(position, day.now_ns)
        says(day, "van-0", "s0", at_ns=day.now_ns + wrong_ns, cycle=plan.cycle)
        assert states(day, "s0") == {"served"}
