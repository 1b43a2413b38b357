"""Whole days of tracker and cycle: who is planned from where, and what becomes of orders."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

from .fleet_drive import SETTINGS, Day, S, Van

STOPS = ("11", "22", "33", "30", "03", "21")
Town = tuple[RoutingProblem, TrafficSnapshot]
Make = Callable[..., Day]


@pytest.fixture
def day(town: Callable[..., Town]) -> Make:
    """A factory of days with two vans of three orders each."""

    def make(**how: object) -> Day:
        stops = [
            {"id": f"s{i}", "node": node, "service_s": 20.0, "demand": 1}
            for i, node in enumerate(STOPS)
        ]
        problem, snapshot = town(stops, [{"capacity": 3}, {"capacity": 3}])
        names = [vehicle.id for vehicle in problem.fleet.vehicles]
        vans = {name: Van(name, "00-01", **how) for name in names}  # type: ignore[arg-type]
        return Day(problem, snapshot, vans, problem.fleet)

    return make


def without(fleet: Fleet, order: str) -> Fleet:
    """A fleet's file that has dropped an order."""
    stops = tuple(stop for stop in fleet.stops if stop.id != order)
    return Fleet(name=fleet.name, depots=fleet.depots, stops=stops, vehicles=fleet.vehicles)


def finish(today: Day, cycles: int = 60) -> None:
    """Until all vans are home and nothing is open."""
    for _ in range(cycles):
        today.run(1)
        done = set(today.states()) <= {"served", "failed", "cancelled"}
        if done and all(van.plan is None for van in today.vans.values()):
            today.run(1)
            return
    raise AssertionError(f"after {cycles} cycles: {today.tracker.book.orders}")


@pytest.mark.slow
@pytest.mark.parametrize("talks", [True, False])
def test_a_day_serves_every_order_once_and_sends_nobody_back(day: Make, talks: bool) -> None:
    """Vans are planned on from where they are; at the end all is served and they are free."""
    today = day(talks=talks)
    today.drive(2)
    finish(today)
    assert today.states() == {"served": 6}
    assert set(today.served().values()) == {1}
    assert today.situation is not None
    assert not today.situation.commitments
    from_depot = [plan for plan in today.sent if plan.continues is None]
    assert len(from_depot) == len({plan.vehicle for plan in from_depot}) == 2
    assert {plan.continues for plan in today.sent} > {None}
    for van in today.vans.values():
        assert set(van.refused) <= {"elsewhere"}


@pytest.mark.slow
def test_a_fleet_that_never_reports_is_planned_as_before(day: Make) -> None:
    """From its depot in each cycle, with all orders."""
    today = day()
    for _ in range(3):
        plans = today.cycle()
        assert today.situation is not None
        assert today.situation.fleet is today.file
        assert {stop.stop for p in plans for stop in p.stops[1:-1]} == {f"s{i}" for i in range(6)}
        assert {p.continues for p in plans} == {None}
        today.now_ns += 30 * S
    assert today.states() == {"planned": 6}


@pytest.mark.slow
def test_plans_on_the_road_are_not_repeated(day: Make) -> None:
    """While nothing changes a van gets a plan some twice a minute less often than it is planned."""
    today = day()
    today.drive(2)
    finish(today)
    cycles = today.number
    # Two vans that wait for each other get new plans when the times of one have moved.
    assert len(today.sent) < 1.4 * cycles
    interval_ns = round(SETTINGS.interval_s * S)
    for van in today.vans.values():
        for before, after in zip(van.plans, van.plans[1:], strict=False):
            if after.continues is not None:
                assert after.issued_ns < before.valid_until_ns - interval_ns // 2


@pytest.mark.slow
def test_a_van_waits_at_a_stop_until_another_comes_by(day: Make) -> None:
    """It goes on waiting while it is planned again, and both drive on together."""
    today = day()
    today.drive(2)
    finish(today)
    waits = [(plan, n) for plan in today.sent for n, s in enumerate(plan.stops) if s.wait_s > 0]
    assert any(n > 0 for _, n in waits)
    standing = [plan for plan, n in waits if n == 0]
    assert standing
    for plan in standing:
        assert plan.continues is not None
        here = plan.stops[0]
        assert here.departure_ns - here.arrival_ns == pytest.approx(here.wait_s * S)
        before = next(
            p for p in today.sent if (p.cycle, p.vehicle) == (plan.continues, plan.vehicle)
        )
        (same,) = [s for s in before.stops if s.stop == here.stop]
        assert abs(same.departure_ns - here.departure_ns) < 15 * S
        together = {s.platoon for s in plan.segments} - {None}
        others = {s.platoon for p in today.sent if p.vehicle != plan.vehicle for s in p.segments}
        assert together & others


def test_a_late_van_is_planned_by_where_it_is(day: Make) -> None:
    """Times shift by what it reports, so that platoons are planned with true times."""
    today = day()
    today.drive(2)
    today.run(1)
    van = today.vans["van-0"]
    assert van.plan is not None
    old = van.plan
    van.late_s += 10.0
    today.drive(1)
    plans = {plan.vehicle: plan for plan in today.cycle()}
    new = plans[van.name]
    assert new.continues == old.cycle
    # So close to the begin, a drive from the present speed is some seconds off one from rest.
    shift_s = (new.stops[1].arrival_ns - old.stops[-len(new.stops) + 1].arrival_ns) / S
    assert shift_s == pytest.approx(10.0, abs=3.0)


@pytest.mark.slow
def test_a_silent_van_keeps_its_orders_and_has_no_partner(day: Make) -> None:
    """Nobody else gets what it has loaded; heard again it goes on, and all is served once."""
    today = day()
    today.drive(2)
    today.run(2)
    van = next(van for van in today.vans.values() if van.plan is not None)
    van.muted_until_ns = today.now_ns + 90 * S
    loaded = set(today.tracker.book.held_by(van.name))
    assert loaded
    today.drive(20)
    plans = today.cycle()
    assert today.situation is not None
    assert today.situation.left_out[van.name] == "silent"
    assert van.name not in {plan.vehicle for plan in plans}
    for plan in plans:
        assert loaded.isdisjoint(stop.stop for stop in plan.stops)
        partners = [s.platoon for s in plan.segments if s.platoon is not None]
        others = [s.platoon for p in plans if p is not plan for s in p.segments]
        assert set(partners) <= set(others)
    finish(today)
    assert set(today.served().values()) == {1}


@pytest.mark.slow
def test_an_unanswered_plan_is_taken_back(day: Make) -> None:
    """A van that reports and does not answer loses its orders to the other one."""
    today = day()
    deaf, other = today.vans.values()
    deaf.deaf = True
    today.drive(2)
    today.run(1)
    assert today.tracker.book.held_by(deaf.name)
    today.run(1)
    assert not today.tracker.book.held_by(deaf.name)
    assert today.situation is not None
    assert deaf.name in today.situation.left_out
    deaf.deaf = False
    finish(today)
    assert set(today.served().values()) == {1}
    assert other.visits


@pytest.mark.slow
def test_a_refused_plan_is_open_for_others(day: Make) -> None:
    """The van is left out for some cycles, with the reason in the order's life."""
    today = day()
    first, _ = today.vans.values()
    first.refuses = True
    today.drive(2)
    today.run(1)
    assert not today.tracker.book.held_by(first.name)
    assert any("not today" in change.reason for change in today.tracker.book.pending()[1])
    today.run(1)
    assert today.situation is not None
    assert first.name in today.situation.left_out
    finish(today)
    assert today.states() == {"served": 6}


@pytest.mark.slow
def test_a_restart_goes_on(day: Make) -> None:
    """A new dispatcher knows orders, plans and vehicles, and hears the visits that it missed."""
    today = day()
    today.drive(2)
    for _ in range(30):
        today.run(1)
        today.restart()
        today.cycle()  # before any van is heard: nobody is sent anywhere
        assert today.situation is not None
        assert not today.situation.commitments
        today.drive(3)
        if set(today.states()) == {"served"}:
            break
    finish(today)
    assert set(today.served().values()) == {1}
    from_depot = [plan for plan in today.sent if plan.continues is None]
    assert len(from_depot) == len({plan.vehicle for plan in from_depot})


@pytest.mark.long
@pytest.mark.slow
def test_an_order_that_is_gone_from_the_file(day: Make) -> None:
    """Open or planned it is cancelled; once loaded it is delivered, and it is not planned twice."""
    today = day()
    today.drive(2)
    today.run(2)
    assert today.file is not None
    van = next(van for van in today.vans.values() if van.is_under_way(today.now_ns))
    loaded = today.tracker.book.held_by(van.name)[-1]
    today.file = without(today.file, loaded)
    today.run(1)
    assert today.tracker.book.orders[loaded].state == "under_way"
    finish(today)
    assert today.states() == {"served": 6}

    early = day()
    early.cycle()
    assert early.file is not None
    early.file = without(early.file, "s0")
    early.cycle()
    assert early.tracker.book.orders["s0"].state == "cancelled"
    early.file = early.problem.fleet
    early.cycle()
    assert early.tracker.book.orders["s0"].state == "planned"


@pytest.mark.slow
def test_a_stay_ends_when_it_would_however_often_it_is_planned_anew(
    town: Callable[..., Town],
) -> None:
    """Plans that begin at the stop where a van stands keep what is left of its service."""
    stops = [
        {"id": name, "node": node, "service_s": 400.0, "demand": 1}
        for name, node in (("s0", "22"), ("s1", "33"))
    ]
    problem, snapshot = town(stops, [{"capacity": 3}])
    vans = {vehicle.id: Van(vehicle.id, "00-01") for vehicle in problem.fleet.vehicles}
    today = Day(problem, snapshot, vans, problem.fleet)
    today.drive(2)
    plans_at_a_stop = set()
    for _ in range(30):
        today.run(1)
        assert today.situation is not None
        for own in today.situation.commitments:
            visit = vans[own.vehicle].visits.get(own.place)
            if own.moving is None and visit is not None and visit.status == "arrived":
                if own.plan.stops[0].stop == own.place:
                    plans_at_a_stop.add(own.plan.cycle)
                assert own.departs_ns / S == pytest.approx(visit.arrived_ns / S + 400.0, abs=2.0)
    assert len(plans_at_a_stop) >= 2


@pytest.mark.slow
def test_orders_stay_with_their_carrier_all_day(town: Callable[..., Town]) -> None:
    """Vans of two carriers on their way are planned on; an order that comes when its carrier's van
    is away waits for it, though another carrier's van is at home.
    """
    names = ("a0", "b0", "a1", "b1", "late-a")
    stops = [
        {"id": name, "node": node, "service_s": 20.0, "carrier": "b" if "b" in name else "a"}
        for name, node in zip(names, STOPS, strict=False)
    ]
    vehicles = [{"carrier": carrier} for carrier in "abbb"]
    problem, snapshot = town(stops, vehicles)
    vans = {van.id: Van(van.id, "00-01") for van in problem.fleet.vehicles}
    today = Day(problem, snapshot, vans, without(problem.fleet, "late-a"))
    today.drive(2)
    today.run(2)
    today.file = problem.fleet
    today.run(1)
    assert today.situation is not None
    assert today.situation.fleet is not None
    away = {own.vehicle for own in today.situation.commitments}
    assert "van-0" in away
    assert len(today.situation.fleet.vehicles) > len(away)
    assert today.tracker.book.orders["late-a"].state == "open"
    finish(today)
    assert today.states() == {"served": 5}
    planned = {(plan.vehicle, stop.stop) for plan in today.sent for stop in plan.service_stops}
    assert {stop for _, stop in planned} == set(names)
    for vehicle, stop in planned:
        assert problem.fleet.vehicle_by_id[vehicle].carrier == ("b" if "b" in stop else "a")


@pytest.mark.slow
def test_a_window_that_closes_on_the_way_does_not_move(town: Callable[..., Town]) -> None:
    """Later plans of a late van have the end of the window that the first one had: it is late."""
    stops = [{"id": "s0", "node": "33", "service_s": 20.0, "demand": 1, "latest_s": 200.0}]
    problem, snapshot = town(stops, [{"capacity": 3}])
    van = Van("van-0", "00-01")
    today = Day(problem, snapshot, {"van-0": van}, problem.fleet)
    today.drive(2)
    today.run(1)
    latest_ns = today.tracker.book.orders["s0"].latest_ns
    assert latest_ns is not None
    for _ in range(20):
        van.late_s += 25.0
        today.run(1)
    later = [plan for plan in today.sent if plan.issued_ns > latest_ns]
    assert later
    assert {stop.latest_ns for plan in later for stop in plan.service_stops} == {latest_ns}
