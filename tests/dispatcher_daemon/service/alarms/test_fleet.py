"""Vehicles that are silent, refuse or come late; orders that failed or that nobody can serve."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dispatcher_daemon.fleet.tracking import NOT_YET, FleetTracker, lateness_s
from dispatcher_daemon.fleet.tracking.vehicle import FRESH_NS
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.route_form.fleet_plan import NO_ROOM
from dispatcher_daemon.planning.routes import NO_WAY, WINDOW_CLOSES
from dispatcher_daemon.service.alarms import fleet_conditions, fleet_lost
from dispatcher_daemon.service.alarms.conditions import STARTED_S
from dispatcher_daemon.service.alarms.fleet import CLOSES_S, WAITED_S
from dispatcher_daemon.service.dispatcher import Dispatcher
from slipstream.messages import (
    OrderRequest,
    PlanAcknowledgement,
    VehiclePlan,
    VehicleProgress,
    Visit,
    acknowledgement_key,
)
from storage import Database, open_database
from tests.dispatcher_daemon.service.reporting import Bus, accept, at, make, tell

Found = list[tuple[str, str, str]]


def conditions(dispatcher: Dispatcher, after_s: float = 0.0, **unserved: str) -> Found:
    """Kind, subject and text of each, some time from now."""
    number, now_ns = dispatcher.delivery.next_number, time.time_ns() + round(1e9 * after_s)
    return dispatcher.fleet_watch.read(
        lambda tracker: [
            (c.kind, c.subject, c.text) for c in fleet_conditions(tracker, unserved, number, now_ns)
        ]
    )


@pytest.fixture
def running(demo: RoutingProblem, tmp_path: Path) -> Any:
    """A dispatcher whose van-a has a plan."""
    bus = Bus()
    with open_database(f"sqlite:///{tmp_path / 'a.db'}") as database:
        dispatcher = make(demo, bus, database)
        dispatcher.run_cycle()
        yield dispatcher, bus.plans("van-a")[0], database


Running = tuple[Dispatcher, VehiclePlan, Database]


def test_a_van_that_falls_silent_with_its_plan(running: Running) -> None:
    """One that has never said anything has never been heard; its orders are late by the clock."""
    dispatcher, plan, _ = running
    assert conditions(dispatcher) == []
    told = conditions(dispatcher, 3600.0)
    unheard = {subject for kind, subject, _ in told if kind == "vehicle_unheard"}
    assert "vehicle/van-a" in unheard
    late = {subject for kind, subject, _ in told if kind == "order_late"}
    assert late >= {f"order/{stop.stop}" for stop in plan.service_stops}
    accept(dispatcher, plan)
    tell(dispatcher, at(plan, plan.segments[0].segment, 0.4))
    assert conditions(dispatcher) == []
    ((kind, subject, text),) = conditions(dispatcher, 1e-9 * FRESH_NS + 1.0)
    assert (kind, subject) == ("vehicle_silent", "vehicle/van-a")
    assert f"plan of cycle {plan.cycle}" in text
    assert f"on {plan.segments[0].segment}" in text
    assert f"{len(plan.service_stops)} orders" in text


def test_brakes_that_do_less_than_declared(running: Running) -> None:
    """As the vehicle's agent tells with its place."""
    dispatcher, plan, _ = running
    accept(dispatcher, plan)
    place = at(plan, plan.segments[0].segment, 0.4)
    tell(dispatcher, place.model_copy(update={"braking_share": 0.62}))
    ((kind, subject, text),) = conditions(dispatcher)
    assert (kind, subject) == ("brakes_weak", "vehicle/van-a")
    assert "62%" in text


def lost(dispatcher: Dispatcher, after_s: float, started_s: float = -STARTED_S) -> list[bool]:
    """Whether no vehicle is heard, some time from now: as what is only awaited, or not."""
    started_ns, now_ns = (time.time_ns() + round(1e9 * s) for s in (started_s, after_s))
    return dispatcher.fleet_watch.read(
        lambda tracker: [c.awaited for c in fleet_lost(tracker, started_ns, now_ns)]
    )


def test_no_vehicle_reports(running: Running) -> None:
    """One is enough, whichever way it reports; after a start they are awaited."""
    dispatcher, plan, _ = running
    assert lost(dispatcher, 1.0) == [False]
    assert lost(dispatcher, STARTED_S - 1.0, started_s=0.0) == [True]
    accept(dispatcher, plan)
    tell(dispatcher, at(plan, plan.segments[0].segment, 0.4))
    silent_s = 1e-9 * FRESH_NS + 1.0
    assert lost(dispatcher, silent_s - 2.0) == []
    assert lost(dispatcher, silent_s) == [False]
    # Heard in the run before only.
    assert lost(dispatcher, silent_s + 2.0, started_s=silent_s) == [True]


def test_vehicles_that_have_nothing_to_do_may_be_silent(running: Running) -> None:
    """But for a fleet that was never heard at all; one without vehicles misses none."""
    dispatcher, plan, _ = running

    def end_all(tracker: FleetTracker) -> None:
        for name in tracker.book.orders:
            tracker.book.settle(name, time.time_ns(), served=True, reason=None)

    dispatcher.fleet_watch.read(end_all)
    assert lost(dispatcher, 3600.0) == [False]
    accept(dispatcher, plan)
    assert lost(dispatcher, 3600.0) == []
    dispatcher.fleet_watch.read(lambda tracker: tracker.list_fleet(None, time.time_ns()))
    assert lost(dispatcher, 3600.0, started_s=-9999.0) == []


def test_a_van_that_refuses_its_plan(running: Running) -> None:
    """Until it is planned again."""
    dispatcher, plan, _ = running
    answer = PlanAcknowledgement(
        vehicle="van-a",
        time_ns=time.time_ns(),
        cycle=plan.cycle,
        accepted=False,
        reason="no driver",
    )
    dispatcher.fleet_watch.on_acknowledgement(acknowledgement_key("van-a"), answer.to_bytes())
    ((kind, subject, text),) = conditions(dispatcher)
    assert (kind, subject) == ("plan_refused", "vehicle/van-a")
    assert "no driver" in text
    dispatcher.delivery.next_number += 9
    assert conditions(dispatcher) == []


def test_orders_that_nobody_can_serve_and_that_failed(running: Running) -> None:
    """An order that has a vehicle by now is none of them; a failed one is told of for a while."""
    dispatcher, plan, _ = running
    stop = plan.service_stops[0].stop
    assert conditions(dispatcher, **{stop: NO_WAY}) == []
    assert conditions(dispatcher, gone=NO_WAY) == []
    accept(dispatcher, plan)
    tell(dispatcher, at(plan, plan.segments[0].segment, 0.4))
    now_ns = time.time_ns()
    visit = Visit(
        stop=stop, arrived_ns=now_ns - 2, ended_ns=now_ns - 1, status="failed", reason="no answer"
    )
    progress = VehicleProgress(vehicle="van-a", time_ns=now_ns, cycle=plan.cycle, visits=(visit,))
    tell(dispatcher, progress)
    failed = [found for found in conditions(dispatcher) if found[0] == "order_failed"]
    assert [(subject, "no answer" in text) for _, subject, text in failed] == [
        (f"order/{stop}", True)
    ]
    assert not [found for found in conditions(dispatcher, 4000.0) if found[0] == "order_failed"]


def test_an_order_that_waits_is_wrong_when_it_waits_too_long(
    demo: RoutingProblem, tmp_path: Path
) -> None:
    """Or when its window is about to close; at once where no vehicle that comes back helps."""
    with open_database(f"sqlite:///{tmp_path / 'a.db'}") as database:
        dispatcher = make(demo, Bus(), database)

        def submit(tracker: FleetTracker) -> None:
            for name, latest_s in (("waits", None), ("closes", 2 * CLOSES_S)):
                latest = None if latest_s is None else time.time_ns() + round(1e9 * latest_s)
                asked = OrderRequest(id=name, node="j", latest=latest)
                tracker.book.submit(asked, "j", time.time_ns())

        dispatcher.fleet_watch.read(submit)
        full = {"waits": NO_ROOM, "closes": NO_ROOM}
        assert conditions(dispatcher, CLOSES_S - 60, **full) == []
        ((kind, subject, text),) = conditions(dispatcher, CLOSES_S + 60, **full)
        assert (kind, subject) == ("order_unserved", "order/closes")
        assert "its window closes at" in text
        assert NO_ROOM in text
        late = {subject: text for _, subject, text in conditions(dispatcher, WAITED_S + 60)}
        assert "it has waited for a vehicle since" in late["order/waits"]
        cannot = f"{WINDOW_CLOSES} at 60 s, the first to arrive is there at 90 s"
        assert conditions(dispatcher, closes=cannot) == [("order_unserved", "order/closes", cannot)]
        later = f"{NOT_YET[0]}: it is planned from tomorrow on"
        assert [s for _, s, _ in conditions(dispatcher, WAITED_S + 60, waits=later)] == [
            "order/closes"
        ]


def test_a_van_that_will_come_too_late(running: Running) -> None:
    """By what it is behind its plan now, less what the plan waits; visited stops count no more."""
    dispatcher, plan, _ = running
    stop = plan.service_stops[0]
    windowed = plan.model_copy(
        update={
            "stops": tuple(
                s.model_copy(update={"latest_ns": s.arrival_ns + 60 * 10**9}) if s == stop else s
                for s in plan.stops
            )
        }
    )
    accept(dispatcher, plan)
    first = plan.segments[0]
    tell(dispatcher, at(plan, first.segment, 0.0))
    vehicle = dispatcher.fleet_watch.vehicles().vehicles["van-a"]
    assert vehicle.accepted is not None
    vehicle.accepted = replace(vehicle.accepted, plan=windowed)

    def late(behind_s: float) -> tuple[str, float] | None:
        now_ns = first.entry_ns + round(1e9 * behind_s)
        assert vehicle.position is not None
        vehicle.position = vehicle.position.model_copy(update={"time_ns": now_ns})
        vehicle.heard_ns = now_ns
        return lateness_s(vehicle, now_ns)

    assert late(0.0) is None
    assert late(59.0) is None
    assert late(100.0) == (stop.stop, pytest.approx(40.0))
    now_ns = first.entry_ns
    visit = Visit(stop=stop.stop, status="arrived", arrived_ns=now_ns, ended_ns=None, reason=None)
    vehicle.progress = VehicleProgress(
        vehicle="van-a", time_ns=now_ns, cycle=plan.cycle, visits=(visit,)
    )
    assert late(100.0) is None
