"""A paused dispatcher begins nothing, keeps what is reported, and is paused after a restart."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher import Control, ControlRefused
from dispatcher_daemon.service.schedule import CycleScheduler
from slipstream.messages import DispatcherHealth, SegmentState, state_key
from storage import Event, StorageError, open_database, open_reader
from tests.dispatcher_daemon.service.logged import Log, make
from tests.dispatcher_daemon.service.reporting import Bus, accept, at, tell
from tests.dispatcher_daemon.service.reporting import make as make_stored

HOUR_NS = 3_600_000_000_000


def test_while_paused_no_cycle_begins_and_no_order_is_inserted(demo: RoutingProblem) -> None:
    """Health says so, and the watchdog is fed: the next cycle is due as ever."""
    log = Log()
    dispatcher = make(demo, log)
    dispatcher.control.pause("ada")
    dispatcher.run_cycle()
    dispatcher.insert(["c1"])
    assert dispatcher.delivery.cycles == 0
    assert dispatcher.delivery.next_number == 7
    soon = time.time_ns() + 10**9
    dispatcher.health.publish(soon)
    health = log.published(DispatcherHealth)[-1]
    assert isinstance(health, DispatcherHealth)
    assert health.paused
    assert dispatcher.is_live(soon)
    dispatcher.control.resume("ada")
    dispatcher.run_cycle()
    assert dispatcher.delivery.cycles == 1
    assert [(event.kind, event.actor) for event in log.told] == [
        ("pause", "ada"),
        ("resume", "ada"),
    ]


@pytest.mark.slow
def test_what_is_reported_meanwhile_is_stored(
    demo: RoutingProblem, state: Callable[..., SegmentState], tmp_path: Path
) -> None:
    """Orders of vehicles under way, and what RSUs see: a restart in the pause loses none of it."""
    url = f"sqlite:///{tmp_path}/a.db"
    bus = Bus()
    with open_database(url) as database, open_reader(url) as reader:
        dispatcher = make_stored(demo, bus, database)
        dispatcher.run_cycle()
        (plan,) = bus.plans("van-a")
        dispatcher.control.pause("ada")
        accept(dispatcher, plan)
        tell(dispatcher, at(plan, plan.segments[0].segment, 0.4))
        old_ns = time.time_ns() - 60 * 10**9
        seen = state("avenue_east", 1, time_ns=time.time_ns())
        dispatcher.receiver.on_state(state_key(seen.rsu, seen.segment), seen.to_bytes())
        dispatcher.run_cycle()
        under_way = {order.order for order in reader.orders(["under_way"])}
        assert under_way == {stop.stop for stop in plan.service_stops}
        assert [report.cycle for report in reader.cycles(9)] == [1]
        dispatcher.receiver.store_rollups(database)
        assert reader.rollups("avenue_east", old_ns - HOUR_NS, old_ns + HOUR_NS)
    with open_database(url) as database:
        again = make_stored(demo, bus, database)
        paused = again.control.paused
        assert paused is not None
        assert paused.by == "ada"
        again.run_cycle()
        assert again.delivery.cycles == 0
        again.control.resume("bob")
    with open_database(url) as database:
        assert make_stored(demo, bus, database).control.paused is None


@pytest.mark.slow
def test_drives_in_a_pause_are_counted_in_it(demo: RoutingProblem, tmp_path: Path) -> None:
    """Their seconds are not kept until it ends, however long that takes."""
    way = ["avenue_east"]
    while len(way) < 4:
        way.append(demo.network.turns(way[-1])[0])
    with open_database(f"sqlite:///{tmp_path}/a.db") as database:
        dispatcher = make_stored(demo, Bus(), database)
        dispatcher.run_cycle()
        dispatcher.control.pause("ada")
        base = at(None, way[0], 0.5)
        for second, segment in enumerate([*way, way[-1]]):
            drives = second < len(way)
            told = {"segment": segment, "time_ns": base.time_ns + second * 10**9}
            tell(dispatcher, base.model_copy(update={**told, "on_road": drives}))
        dispatcher.run_cycle()
        counted = database.load_fleet(time.time_ns()).movements
    assert {(one.segment, one.following) for one in counted} == set(pairwise(way[1:]))


@pytest.mark.slow
def test_a_pause_is_stored_in_the_database_that_took_the_place(
    demo: RoutingProblem, tmp_path: Path
) -> None:
    """One that was deleted meanwhile is noticed though no cycle runs."""
    url, bus = f"sqlite:///{tmp_path}/a.db", Bus()
    with open_database(url, owned=True) as database:
        dispatcher = make_stored(demo, bus, database)
        dispatcher.run_cycle()
        dispatcher.control.pause("ada")
        for path in tmp_path.glob("a.db*"):
            if not path.name.endswith("-lock"):
                path.unlink()
        dispatcher.run_cycle()
        assert dispatcher.delivery.unstored is not None
        dispatcher.run_cycle()
        assert dispatcher.delivery.unstored is None
    with open_database(url) as database:
        paused = make_stored(demo, bus, database).control.paused
        assert paused == dispatcher.control.paused


def test_a_cycle_now(demo: RoutingProblem) -> None:
    """At once instead of with the interval; refused while it is paused, or one runs."""
    log, times = Log(), list[float]()
    dispatcher = make(demo, log)
    control = dispatcher.control
    scheduler = CycleScheduler(lambda: times.append(time.monotonic()), 3600.0)
    control.run_soon = lambda: dispatcher.cycle_began is None and scheduler.run_soon()
    scheduler.start()
    try:
        deadline = time.monotonic() + 60
        while not times and time.monotonic() < deadline:
            time.sleep(0.01)
        control.cycle("ada")
        while len(times) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert len(times) == 2
        dispatcher.cycle_began = time.monotonic()
        with pytest.raises(ControlRefused, match="runs now"):
            control.cycle("ada")
        dispatcher.cycle_began = None
        control.pause("bob")
        with pytest.raises(ControlRefused, match="paused by bob; resume it first"):
            control.cycle("ada")
        control.resume("bob")
        while len(times) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert len(times) == 3
    finally:
        scheduler.stop()


class Away:
    """A store that cannot be written."""

    def save_events(self, changed: Sequence[Event]) -> None:
        """Fail."""
        raise StorageError("x.db: disk full")

    def last_event(self, kinds: object) -> Event | None:
        """None."""
        return None


def test_what_cannot_be_stored_has_not_happened() -> None:
    """A pause that a restart would forget is none."""
    control = Control(Away())
    with pytest.raises(StorageError):
        control.pause("ada")
    assert control.paused is None
