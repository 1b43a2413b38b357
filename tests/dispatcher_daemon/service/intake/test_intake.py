"""Orders of callers: durable when they are told so, planned with the file's, ended once."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.fleet import fleet_from
from dispatcher_daemon.fleet.file import FleetFile
from dispatcher_daemon.fleet.tracking import HIDDEN
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.service.intake import OrderIntake, OrdersRefused
from slipstream.messages import (
    CycleReport,
    OrderReceipt,
    OrderRequest,
    VehiclePosition,
    position_key,
)
from slipstream.orders import FleetRecords, OrderChange, OrderRecord, OrderRefused
from storage import OrderKnownError, StorageError, open_reader
from tests.dispatcher_daemon.service.reporting import accept

from .conftest import request
from .desk import SOLVE, depart, opened

S = 10**9


def in_s(seconds: float) -> int:
    """UTC so long from now."""
    return time.time_ns() + round(S * seconds)


def refused(act: Callable[[], object]) -> tuple[str, str]:
    """Kind and problem of a refusal."""
    with pytest.raises((OrderRefused, OrdersRefused)) as caught:
        act()
    error = caught.value
    refusal = error.refusal if isinstance(error, OrderRefused) else error.refusals[0]
    return refusal.kind, refusal.problem


@pytest.mark.slow
def test_an_orders_whole_life_is_there_after_each_restart(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """Submitted, planned with the file's, under way, served: by four dispatchers in turn."""
    asked = request("o-1", demand=2, latest=in_s(7200), skills=("lift",))
    with opened(district, tmp_path) as desk:
        ((receipt, is_new),) = desk.intake.submit([asked])
        assert is_new
        assert receipt.node == "11"
    with opened(district, tmp_path) as desk:  # killed before any cycle
        assert desk.intake.submit([asked]) == [(receipt, False)]
        desk.dispatcher.run_cycle()
        (plan,) = desk.bus.plans("van-0")
        assert "o-1" in {stop.stop for stop in plan.service_stops}
        told = desk.intake.show("o-1")
        (visit,) = (stop for stop in plan.stops if stop.stop == "o-1")
        assert (told.state, told.vehicle, told.cycle) == ("planned", "van-0", plan.cycle)
        assert told.arrival_ns == visit.arrival_ns < visit.latest_ns == asked.latest
        accept(desk.dispatcher, plan)
        depart(desk, plan)
        desk.dispatcher.run_cycle()
    with opened(district, tmp_path) as desk:
        desk.visit("van-0", "o-1")
        assert desk.state("o-1") == "under_way"  # where it was is not known
        depart(desk, plan, "o-1")
        assert desk.state("o-1") == "served"  # before it is stored
        assert refused(lambda: desk.intake.cancel("o-1"))[0] == "too_late"
        desk.dispatcher.run_cycle()
    with opened(district, tmp_path) as desk:
        told = desk.intake.show("o-1")
        assert [step.state for step in told.history] == ["open", "planned", "under_way", "served"]
        assert told.request == asked
        assert desk.intake.submit([asked]) == [
            (receipt.model_copy(update={"state": "served"}), False)
        ]
        desk.dispatcher.run_cycle()
        plans = [*desk.bus.plans("van-0"), *desk.bus.plans("van-1")]
        assert not any(stop.stop == "o-1" for plan in plans for stop in plan.stops)


@pytest.mark.slow
def test_orders_come_in_while_a_cycle_runs(district: RoutingProblem, tmp_path: Path) -> None:
    """From two threads at once; all are durable before it ends, and the next one plans them."""
    entered, go_on = threading.Event(), threading.Event()

    def slow(jobs: Any, deadline_s: float) -> Any:
        entered.set()
        assert go_on.wait(30.0)
        return SOLVE(jobs, deadline_s)

    with opened(district, tmp_path, slow) as desk, ThreadPoolExecutor(3) as threads:
        # Two vans with something to do, so that the solvers are asked.
        desk.intake.submit([request("first", node="33"), request("second", node="30")])
        cycle = threads.submit(desk.dispatcher.run_cycle)
        assert entered.wait(30.0)
        names = [f"o-{n}" for n in range(20)]

        def send(some: list[str]) -> list[OrderReceipt]:
            return [desk.intake.submit([request(name)])[0][0] for name in some]

        halves = [threads.submit(send, names[:12]), threads.submit(send, names[8:])]
        receipts = [receipt for half in halves for receipt in half.result(30.0)]
        assert not cycle.done()
        stored = {order.order for order in desk.database.load_fleet(time.time_ns()).orders}
        assert stored >= {*names}
        assert len({(r.order, r.received_ns) for r in receipts}) == 20  # 4 were sent by both
        go_on.set()
        cycle.result(30.0)
        assert {desk.state(name) for name in names} == {"open"}
        desk.dispatcher.run_cycle()
        assert {desk.state(name) for name in names} == {"planned"}


@pytest.mark.slow
def test_an_order_is_cancelled_until_its_vehicle_has_left(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """Open or planned; once more changes nothing. The file's orders are the file's affair."""
    with opened(district, tmp_path) as desk:
        intake = desk.intake
        intake.submit([request("open"), request("planned", vehicle="van-0")])
        intake.submit([request("gone", vehicle="van-1")])
        assert intake.cancel("open").state == "cancelled"
        desk.dispatcher.run_cycle()
        assert intake.cancel("planned").state == "cancelled"
        assert intake.cancel("planned").reason == "cancelled by its caller"
        (plan,) = desk.bus.plans("van-1")
        accept(desk.dispatcher, plan)
        assert refused(lambda: intake.pin("gone", "van-0"))[0] == "too_late"
        depart(desk, plan)
        assert refused(lambda: intake.cancel("gone")) == ("too_late", "van-1 has left with it")
        assert refused(lambda: intake.pin("gone", "van-0"))[0] == "too_late"
        assert refused(lambda: intake.cancel("of-the-file"))[0] == "conflict"
        assert refused(lambda: intake.cancel("none")) == ("not_found", "no such order")
        desk.dispatcher.run_cycle()
        assert desk.state("open") == desk.state("planned") == "cancelled"


@pytest.mark.slow
def test_a_pinned_order_stays_with_its_vehicle(district: RoutingProblem, tmp_path: Path) -> None:
    """Through cycles and restarts, until it is released; who could not serve it is refused."""
    with opened(district, tmp_path) as desk:
        intake = desk.intake
        intake.submit([request("o", vehicle="van-1"), request("heavy", demand=7)])
        assert refused(lambda: intake.pin("heavy", "van-0"))[0] == "invalid"
        assert refused(lambda: intake.pin("heavy"))[1] == "no vehicle has it yet"
        desk.dispatcher.run_cycle()
        assert intake.show("o").vehicle == "van-1"
        assert intake.pin("o", "van-0").pinned == "van-0"
        assert intake.pin("of-the-file", "van-1").pinned == "van-1"
        for _ in range(2):
            desk.dispatcher.run_cycle()
            assert intake.show("o").vehicle == "van-0"
            assert intake.show("of-the-file").vehicle == "van-1"
    with opened(district, tmp_path) as desk:
        assert desk.intake.show("of-the-file").pinned == "van-1"
        assert desk.intake.release("o").pinned is None
        reasons = [step.reason for step in desk.intake.show("o").history]
        assert reasons[-1] == "released from van-0"
        assert "pinned to van-0" in reasons


def test_windows_are_kept_in_absolute_time(district: RoutingProblem, tmp_path: Path) -> None:
    """An order is not planned long before its window, and has failed when it has closed."""
    with opened(district, tmp_path) as desk:
        now_ns = [time.time_ns()]
        intake = OrderIntake(
            desk.dispatcher.fleet_watch,
            desk.database,
            open_reader(f"sqlite:///{tmp_path / 'a.db'}"),
            district.network,
            lambda: now_ns[0] - 60 * S,  # they came a minute ago
        )
        intake.submit(
            [
                request("later", earliest=in_s(8 * 3600)),
                request("over", latest=in_s(-5)),
                request("soon", latest=in_s(5)),
            ]
        )
        desk.dispatcher.run_cycle()
        later, over, soon = (desk.intake.show(name) for name in ("later", "over", "soon"))
        assert (later.state, over.state, soon.state) == ("open", "failed", "open")
        assert "its window opens later: it is planned from 2" in str(later.unplanned)
        assert over.reason.startswith("its window closed at 2")
        assert soon.unplanned == "its window closes before a plan can be out"


def test_a_fleet_without_stops_serves_what_is_submitted(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """Nothing in the file is nothing to do until an order comes."""
    fleet = district.fleet.model_copy(update={"stops": ()})
    with opened(RoutingProblem(district.network, fleet), tmp_path) as desk:
        desk.dispatcher.run_cycle()
        desk.intake.submit([request("o")])
        desk.dispatcher.run_cycle()
        reports = [m for m in desk.bus.sent if isinstance(m, CycleReport)]
        assert [r.reason for r in reports] == ["no open order, or no free vehicle", None]
        assert desk.state("o") == "planned"


@dataclass
class Memory:
    """A database that may be full."""

    orders: dict[str, OrderRecord] = field(default_factory=dict)
    changes: list[OrderChange] = field(default_factory=list)
    full: bool = False

    def save_fleet(self, records: FleetRecords) -> None:
        """As `Database.save_fleet`."""
        if self.full:
            raise StorageError("a.db: disk full")
        self.orders.update({order.order: order for order in records.orders})
        self.changes += records.changes

    def add_orders(self, records: FleetRecords) -> None:
        """As `Database.add_orders`."""
        if any(order.order in self.orders for order in records.orders):
            raise OrderKnownError("a.db: known")
        self.save_fleet(records)

    def find_orders(self, names: Collection[str]) -> tuple[OrderRecord, ...]:
        """As `Reader.find_orders`."""
        return tuple(self.orders[name] for name in names if name in self.orders)

    def order_changes(self, order: str) -> tuple[OrderChange, ...]:
        """As `Reader.order_changes`."""
        return tuple(change for change in self.changes if change.order == order)


def test_a_receipt_tells_how_far_from_its_place_an_order_is_served(
    district: RoutingProblem,
) -> None:
    """To the junction, not to the road, and the same when it is sent again; nothing where the
    caller names the junction.
    """
    now_ns, memory = 1_800_000_000 * S, Memory()
    watch = FleetWatch(district.network, FleetRecords(), 0, lambda: now_ns, print)
    watch.fleet = district.fleet
    intake = OrderIntake(watch, memory, memory, district.network, lambda: now_ns)
    asked = [request("by-place", lat=0.32, lon=0.35), request("by-node")]
    found = [receipt for receipt, _ in intake.submit(asked)]
    place = district.network.junctions[found[0].node]
    assert found[0].distance_m == pytest.approx(math.dist((350.0, 320.0), place), abs=0.1)
    assert found[1].distance_m is None
    assert [receipt for receipt, _ in intake.submit(asked)] == found


def test_an_order_that_the_tracker_has_forgotten_has_its_first_receipt(
    district: RoutingProblem,
) -> None:
    """Its window has closed long ago, by which a new one is refused; beside new ones too."""
    now_ns = [1_800_000_000 * S]
    memory = Memory()

    def start() -> OrderIntake:
        watch = FleetWatch(district.network, FleetRecords(), 0, lambda: now_ns[0], print)
        watch.fleet = district.fleet
        return OrderIntake(watch, memory, memory, district.network, lambda: now_ns[0])

    old = OrderRequest(id="old", node="11", latest=now_ns[0] + 60 * S)
    ((receipt, is_new),) = start().submit([old])
    assert is_new
    now_ns[0] += 3 * 86_400 * S
    again = start()
    assert again.submit([old]) == [(receipt, False)]
    found = again.submit([OrderRequest(id="new", node="22"), old])
    assert [(r.order, is_new) for r, is_new in found] == [("new", True), ("old", False)]
    without = OrderRequest(id="old", node="11")
    with pytest.raises(OrdersRefused) as refused:
        again.submit([OrderRequest(id="third", node="22"), without])
    assert [r.kind for r in refused.value.refusals] == ["conflict"]
    assert set(memory.orders) == {"old", "new"}


CONTENTS = [{"node": "11"}, {"node": "22"}, {"node": "11", "demand": 1}, {"node": "p"}]
SENT = st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 3)), min_size=1, max_size=3)


ACTIONS = st.sampled_from(["send", "send", "full", "restart"])


@pytest.mark.slow
@given(steps=st.lists(st.tuples(ACTIONS, SENT), max_size=8))
@settings(max_examples=30, deadline=None)
def test_what_was_acknowledged_is_there_and_nothing_else(
    district: RoutingProblem, steps: list[tuple[str, list[tuple[str, int]]]]
) -> None:
    """Repetitions, other contents, faults and restarts in any order: all or none of each
    submission, one receipt for each order.
    """
    memory, receipts = Memory(), dict[str, tuple[int, OrderReceipt]]()
    now_ns = [1_800_000_000 * S]

    def clock() -> int:
        now_ns[0] += 1
        return now_ns[0]

    def start() -> OrderIntake:
        records = FleetRecords(orders=tuple(memory.orders.values()))
        watch = FleetWatch(district.network, records, 0, clock, print)
        watch.fleet = district.fleet
        return OrderIntake(watch, memory, memory, district.network, clock)

    intake = start()
    for what, sent in steps:
        if what == "restart":
            intake = start()
            continue
        memory.full = what == "full"
        requests = [OrderRequest(id=name, **CONTENTS[n]) for name, n in sent]  # type: ignore[arg-type]
        content = {name: n for name, (n, _) in receipts.items()}
        fits = all(content.setdefault(name, n) == n and n != 3 for name, n in sent)
        has_new = not {name for name, _ in sent} <= receipts.keys()
        if fits and not (has_new and memory.full):
            for (receipt, is_new), (name, n) in zip(intake.submit(requests), sent, strict=True):
                assert is_new == (name not in receipts)
                assert receipts.setdefault(name, (n, receipt)) == (n, receipt)
        else:
            with pytest.raises((OrdersRefused, StorageError)):
                intake.submit(requests)
        assert memory.orders.keys() == receipts.keys()
        assert {status.order for status in intake.page()} == receipts.keys()
        assert [len(intake.show(name).history) for name in receipts] == [1] * len(receipts)


def test_a_pin_never_stands_against_a_first_stop(district: RoutingProblem, tmp_path: Path) -> None:
    """The pin of another vehicle's first stop is refused; if the file names one later that is
    pinned, the pin holds and cycles go on.
    """
    fleet = district.fleet
    first = fleet.vehicles[0].model_copy(update={"first_stop": "of-the-file"})
    loaded = fleet_from(
        fleet.model_copy(update={"vehicles": (first, *fleet.vehicles[1:])}).model_dump(
            mode="json", exclude_none=True
        ),
        district.network,
        "loaded",
    )
    with opened(replace(district, fleet=loaded), tmp_path) as desk:
        watch = desk.dispatcher.fleet_watch
        watch.situation(loaded, 1, time.time_ns(), 1.0)
        assert refused(lambda: desk.intake.pin("of-the-file", "van-1"))[0] == "conflict"
        assert desk.intake.pin("of-the-file", "van-0").pinned == "van-0"
        watch.situation(fleet, 1, time.time_ns(), 1.0)
        assert desk.intake.pin("of-the-file", "van-1").pinned == "van-1"
        found = watch.situation(loaded, 1, time.time_ns(), 1.0).fleet
        assert found is not None
        assert found.vehicle_by_id["van-0"].first_stop is None
        assert found.stop_by_id["of-the-file"].vehicle == "van-1"


def test_a_busy_database_holds_nobody_else_up(
    district: RoutingProblem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While another thread has the writer for long, an order is refused for now, nothing has
    happened, and the fleet can be read in between.
    """
    monkeypatch.setattr("storage.database.TURN_WITHIN_S", 0.1)
    with opened(district, tmp_path) as desk, ThreadPoolExecutor(1) as threads:
        desk.intake.submit([request("known")])
        busy, over = threading.Event(), threading.Event()

        def hold() -> None:
            with desk.database._lock:
                busy.set()
                over.wait(60.0)

        threads.submit(hold)
        assert busy.wait(60.0)
        try:
            for act in (
                lambda: desk.intake.cancel("known"),
                lambda: desk.intake.cancel("past"),
                lambda: desk.intake.submit([request("new")]),
            ):
                with pytest.raises(StorageError, match="busy"):
                    act()
            assert desk.state("known") == "open"
            assert desk.dispatcher.fleet_watch.figures()[2]["open"] >= 1
        finally:
            over.set()
        assert desk.intake.cancel("known").state == "cancelled"


@pytest.mark.slow
def test_an_order_on_offer_is_not_pinned_to_another(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """As long as a vehicle that reports has not answered the plan with it."""
    with opened(district, tmp_path) as desk:
        desk.intake.submit([request("o", vehicle="van-1")])
        desk.dispatcher.run_cycle()
        assert desk.bus.plans("van-1")
        at_home = VehiclePosition(
            vehicle="van-1",
            time_ns=time.time_ns(),
            segment="00-01",
            share=0.0,
            speed_mps=0.0,
            on_road=False,
            cycle=None,
            leg=None,
        )
        payload = at_home.to_bytes()
        desk.dispatcher.fleet_watch.on_position(position_key("van-1"), payload)
        kind, problem = refused(lambda: desk.intake.pin("o", "van-0"))
        assert (kind, "not answered" in problem) == ("too_late", True)
        assert desk.intake.pin("o").pinned == "van-1"


def test_a_pin_of_the_files_stop_is_checked_by_what_the_file_asks(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """Carrier and skills, which the order's record does not have."""
    for asked, key in ({"carrier": "smith"}, "carrier"), ({"skills": ["lift"]}, "skills"):
        data = district.fleet.model_dump(mode="json", exclude_none=True)
        data["stops"][0] |= asked
        fleet = fleet_from(data, district.network, "asking")
        path = tmp_path / key
        path.mkdir()
        with opened(replace(district, fleet=fleet), path) as desk:
            desk.dispatcher.fleet_watch.situation(fleet, 1, time.time_ns(), 1.0)
            with pytest.raises(OrderRefused) as caught:
                desk.intake.pin("of-the-file", "van-1")
            assert caught.value.refusal.key == key
            assert desk.intake.pin("of-the-file", "van-0").pinned == "van-0"


def test_a_change_is_told_before_any_other_can_follow(
    district: RoutingProblem, tmp_path: Path
) -> None:
    """While it is told, the fleet's lock is held; what is not stored is not told."""
    with opened(district, tmp_path) as desk:
        watch, told = desk.dispatcher.fleet_watch, list[tuple[str, bool]]()

        def announce(change: OrderChange) -> None:
            told.append((change.state, watch._lock.locked()))

        archive = open_reader(f"sqlite:///{tmp_path / 'a.db'}")
        intake = OrderIntake(watch, desk.database, archive, district.network, announce=announce)
        intake.submit([request("o")])
        intake.cancel("o")
        with pytest.raises(OrdersRefused):
            intake.submit([request("p"), request("q", node="nowhere")])
        assert told == [("open", True), ("cancelled", True)]


def test_a_stop_of_the_file_takes_its_id_over_when_a_callers_order_has_ended(
    district: RoutingProblem, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Until then it is not planned, and the log and the cycle's report say so."""
    data = district.fleet.model_dump(mode="json", exclude_none=True)
    data["stops"].append({"id": "o", "node": "22"})
    path = tmp_path / "later.json"
    path.write_text(json.dumps(data))
    later = fleet_from(data, district.network, "later")
    with opened(district, tmp_path, fleet_file=FleetFile(str(path), district.network)) as desk:
        watch = desk.dispatcher.fleet_watch
        watch.situation(district.fleet, 1, time.time_ns(), 1.0)
        desk.intake.submit([request("o")])
        assert watch.situation(later, 1, time.time_ns(), 1.0).hidden == ("o",)
        assert desk.intake.show("o").node == "11"
        desk.dispatcher.run_cycle()
        assert "callers' orders have their ids: o" in caplog.text
        last = desk.dispatcher.delivery.last
        assert last is not None
        assert [stop.stop for stop in last.unserved if stop.reason == HIDDEN] == ["o"]
        desk.intake.cancel("o")
        assert watch.situation(later, 2, time.time_ns(), 1.0).hidden == ()
        told = desk.intake.show("o")
        assert (told.node, told.state, told.request) == ("22", "open", None)
        desk.dispatcher.run_cycle()
    with opened(district, tmp_path) as desk:
        told = desk.intake.show("o")
        assert (told.node, told.state, told.request) == ("22", "planned", None)
        assert [s.state for s in told.history] == [
            "open",
            "planned",
            "cancelled",
            "open",
            "planned",
        ]
