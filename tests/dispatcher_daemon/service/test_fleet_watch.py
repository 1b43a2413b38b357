"""The dispatcher with a fleet that reports: bus messages in, database and plans out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from dispatcher_daemon.fleet.tracking import FRESH_NS
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.daemon import has_heard_all
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.traffic.snapshot import take_snapshot
from slipstream.explain import explanation
from slipstream.messages import (
    CycleReport,
    DispatcherHealth,
    SegmentState,
    VehicleProgress,
    Visit,
    acknowledgement_key,
    position_key,
    progress_key,
    state_key,
)
from slipstream.orders import FleetRecords
from storage import StorageError, open_database, open_reader
from tests.dispatcher_daemon.service.reporting import Bus, accept, at, make, tell


@pytest.fixture
def url(tmp_path: Path) -> str:
    """A database."""
    return f"sqlite:///{tmp_path / 'a.db'}"


@pytest.mark.slow
def test_a_restart_waits_for_those_that_the_run_before_knew(
    demo: RoutingProblem, url: str, state: Callable[..., SegmentState]
) -> None:
    """Its first cycle would leave them out; and for each listed RSU, as gates need their states."""
    bus, rsus = Bus(), {"rsu-avenue_east": ("avenue_east",)}
    seen = state("avenue_east", 1, time_ns=time.time_ns())
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
        assert has_heard_all(dispatcher, rsus)  # nobody is known
        dispatcher.run_cycle()
        (plan,) = bus.plans("van-a")
        accept(dispatcher, plan)
        tell(dispatcher, at(plan, plan.segments[0].segment, 0.4))
        dispatcher.run_cycle()
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        assert [vehicle.id for vehicle in dispatcher.fleet_watch.silent()] == ["van-a"]
        tell(dispatcher, at(plan, plan.segments[0].segment, 0.5))
        assert not has_heard_all(dispatcher, rsus)
        dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
        assert has_heard_all(dispatcher, rsus)
        assert not has_heard_all(dispatcher, None)
        assert not has_heard_all(dispatcher, {**rsus, "rsu-avenue_west": ("avenue_west",)})


@pytest.mark.slow
def test_a_van_in_mid_route_is_never_planned_from_its_depot(demo: RoutingProblem, url: str) -> None:
    """Nor after a restart; its orders are under way, and what it has served is not planned."""
    bus = Bus()
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()  # nobody has reported: as ever
        (plan,) = bus.plans("van-a")
        accept(dispatcher, plan)
        tell(dispatcher, at(plan, plan.segments[0].segment, 0.4))
        for _ in range(3):
            dispatcher.run_cycle()
        (later,) = bus.plans("van-a")[1:]  # and no other before it is answered
        accept(dispatcher, later)
        tell(dispatcher, at(later, plan.segments[0].segment, 0.5))  # not stored any more
        dispatcher.health.publish(None)
    own = {stop.stop for stop in plan.stops[1:-1]}
    assert later.continues == plan.cycle
    assert later.segments[0].segment == plan.segments[0].segment
    plan = later
    health = bus.sent[-1]
    assert isinstance(health, DispatcherHealth)
    assert (health.vehicles_reporting, health.vehicles_silent) == (1, 0)
    assert health.orders["under_way"] == len(own)
    with open_reader(url) as reader:
        orders = {order.order: order for order in reader.orders()}
        assert {n for n, o in orders.items() if o.state == "under_way"} == own
        life = [change.state for change in reader.order_changes(min(own))]
        assert life == ["open", "planned", "under_way"]
    with open_database(url) as database:
        bus.sent.clear()
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()  # it has not been heard of since the start
        assert bus.plans("van-a") == []
        first = plan.stops[1]
        visit = Visit(
            stop=first.stop,
            status="served",
            arrived_ns=time.time_ns(),
            ended_ns=time.time_ns(),
            reason=None,
        )
        progress = VehicleProgress(
            vehicle="van-a", time_ns=time.time_ns(), cycle=plan.cycle, visits=(visit,)
        )
        tell(dispatcher, progress)
        second = next(s for s in plan.segments if s.leg == 1)
        tell(dispatcher, at(plan, second.segment, 0.5, leg=1))
        dispatcher.run_cycle()
        (new,) = bus.plans("van-a")
    assert new.stops[0].stop == first.stop
    assert [s.stop for s in new.stops[1:-1]] == [s.stop for s in plan.stops[2:-1]]
    assert new.segments[0].segment == second.segment
    with open_reader(url) as reader:
        assert reader.orders(("served",))[0].order == first.stop


@pytest.mark.slow
def test_measured_speeds_are_learned_and_survive_a_restart(
    demo: RoutingProblem, url: str, state: Callable[..., SegmentState]
) -> None:
    """Each cycle with a fresh state counts once; a road that is not seen is as slow as usual."""

    def report(dispatcher: Dispatcher) -> None:
        seen = msgspec.structs.replace(state("avenue_east", 0), time_ns=time.time_ns())
        dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
        dispatcher.run_cycle()

    with open_database(url) as database:
        first = make(demo, Bus(), database)
        report(first)
        first.run_cycle()
        (learned,) = database.load_fleet(time.time_ns()).speeds
        features = state("avenue_east", 0).features
        assert features is not None
        assert learned.segment == "avenue_east"
        assert learned.count == 2.0
        assert learned.speed_mps == pytest.approx(2 * features.mean_speed_mps.value)
        more = replace(learned, count=100.0, speed_mps=700.0)
        database.save_fleet(FleetRecords(speeds=(more,)))
        again = make(demo, Bus(), database)
        unseen = take_snapshot(demo.network, (), time.time_ns(), stale_after_s=5.0)
        expected = again.fleet_watch.expected(unseen)
        assert expected.segments["avenue_east"].speed_mps == pytest.approx(7.0, abs=0.5)
        assert expected.segments["avenue_west"] == unseen.segments["avenue_west"]


@pytest.mark.slow
def test_visits_of_past_tours_are_not_kept(demo: RoutingProblem, url: str) -> None:
    """An agent repeats its last 200; of 1,000 vehicles they would be 200 MB."""

    def visit(stop: str) -> Visit:
        now_ns = time.time_ns()
        return Visit(stop=stop, status="arrived", arrived_ns=now_ns, ended_ns=None, reason=None)

    bus = Bus()
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()
        (plan,) = bus.plans("van-a")
        accept(dispatcher, plan)
        own = plan.service_stops[0].stop
        visits = tuple(visit(stop) for stop in (*(f"past-{n}" for n in range(200)), own))
        told = VehicleProgress(
            vehicle="van-a", time_ns=time.time_ns(), cycle=plan.cycle, visits=visits
        )
        tell(dispatcher, told)
        kept = dispatcher.fleet_watch.read(lambda tracker: tracker.vehicles["van-a"].progress)
    assert kept is not None
    assert kept.visits == visits[-1:]


@pytest.mark.slow
def test_cycles_that_cannot_be_stored_leave_no_steps(
    demo: RoutingProblem, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A day of a full disk is thousands of cycles: what waits to be stored does not grow by them,
    and an order's life does not tell of plans that nobody was sent.
    """

    def pending(dispatcher: Dispatcher) -> int:
        return dispatcher.fleet_watch.read(lambda tracker: len(tracker.book.pending()[1]))

    def full(*_: object) -> None:
        raise StorageError("the disk is full")

    bus = Bus()
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        with monkeypatch.context() as patch:
            patch.setattr(database, "record_cycle", full)
            dispatcher.run_cycle()
            first = pending(dispatcher)
            dispatcher.run_cycle()
            dispatcher.run_cycle()
            assert pending(dispatcher) == first
        assert dispatcher.delivery.failed == 3
        assert bus.plans("van-a") == []
        dispatcher.run_cycle()
        (plan,) = bus.plans("van-a")
        assert pending(dispatcher) == 0
    with open_reader(url) as reader:
        for stop in plan.service_stops:
            life = [change.state for change in reader.order_changes(stop.stop)]
            assert life == ["open", "planned"]


def test_messages_that_are_not_what_their_key_says_are_counted(
    demo: RoutingProblem, url: str
) -> None:
    """Garbage, another vehicle's key, a road of another network."""
    bus = Bus()
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        watch = dispatcher.fleet_watch
        here = at(None, "avenue_east", 0.0)
        watch.on_position(position_key("van-b"), here.to_bytes())
        watch.on_position(position_key("van-a"), b"{}")
        watch.on_progress(progress_key("van-a"), here.to_bytes())
        watch.on_acknowledgement(acknowledgement_key("van-a"), b"\xff")
        strange = here.model_copy(update={"segment": "moon_street"})
        watch.on_position(position_key("van-a"), strange.to_bytes())
        assert dispatcher.receiver.bad_messages == 5
        dispatcher.run_cycle()
    assert len(bus.plans("van-a")) == 1


@pytest.mark.slow
def test_a_fleet_that_is_silent_does_not_look_well(demo: RoutingProblem, url: str) -> None:
    """Each order says why it waits, in the stored report and in words; health names the silent ones
    with their last place, and those that were never heard.
    """
    bus, silent_ns = Bus(), FRESH_NS + 10**9
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()
        dispatcher.health.publish(None)
        health = bus.sent[-1]
        assert isinstance(health, DispatcherHealth)
        assert set(health.unheard) == {"van-a", "van-b"}
        for vehicle in ("van-a", "van-b"):
            (plan,) = bus.plans(vehicle)
            accept(dispatcher, plan)
            tell(dispatcher, at(plan, plan.segments[0].segment, 0.4, vehicle=vehicle))
        later_ns = time.time_ns() + silent_ns
        situation = dispatcher.fleet_watch.situation(demo.fleet, 2, later_ns, 1.0)
        orders = dispatcher.fleet_watch.read(lambda tracker: dict(tracker.book.orders))
        assert set(situation.waiting) == set(orders)
        assert all("silent since" in reason for reason in situation.waiting.values())
        dispatcher.delivery.store_fleet(time.time_ns())
    with open_database(url) as database:
        dispatcher = make(demo, bus, database)  # nobody has been heard since its start
        dispatcher.run_cycle()
        report = bus.sent[-1]
        assert isinstance(report, CycleReport)
        dispatcher.health.publish(None)
        health = bus.sent[-1]
    assert {one.stop for one in report.unserved} == set(orders)
    assert f"{len(orders)} orders wait" in str(report.reason)
    # They have a plan: they do not stand idle.
    assert "idle" not in str(report.reason)
    assert isinstance(health, DispatcherHealth)
    assert not health.unheard
    assert health.vehicles_silent == len(health.silent) == 2
    assert sum(one.orders for one in health.silent) == len(orders)
    assert all(one.segment is not None and one.share == 0.4 for one in health.silent)
    with open_reader(url) as reader:
        stored = reader.latest_cycle()
    assert stored is not None
    words = explanation(stored, (), None)
    assert len(words.unserved) == len(orders)
    assert all("silent since" in line for line in words.unserved)
