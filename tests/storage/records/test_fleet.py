"""Orders, plans in force and vehicles: stored with a cycle, loaded by the next dispatcher."""

from __future__ import annotations

from dataclasses import replace

import pytest

import storage
from slipstream.messages import PlanAcknowledgement, VehiclePosition
from slipstream.orders import (
    FleetRecords,
    MovementSum,
    OrderChange,
    OrderRecord,
    PlanChange,
    PlanRecord,
    SpeedSum,
    VehicleRecord,
)

NOW_NS = 1_790_000_000_000_000_000
DAY_NS = 86_400_000_000_000


def make_order(name: str, **changes: object) -> OrderRecord:
    """An order that is planned."""
    order = OrderRecord(
        order=name,
        node="n1",
        service_s=60.0,
        demand=2,
        earliest_ns=NOW_NS,
        latest_ns=None,
        state="planned",
        since_ns=NOW_NS,
        reason="in the plan of cycle 1",
        vehicle="van-a",
        cycle=1,
    )
    return replace(order, **changes)


def change_of(order: OrderRecord) -> OrderChange:
    """The change that led to an order's present state."""
    return OrderChange(
        order.order, order.since_ns, order.state, order.reason, order.vehicle, order.cycle
    )


POSITION = VehiclePosition(
    vehicle="van-a",
    time_ns=NOW_NS,
    segment="avenue_east",
    share=0.5,
    speed_mps=10.0,
    on_road=True,
    cycle=1,
    leg=0,
)
VEHICLE = VehicleRecord(
    "van-a",
    {"id": "van-a"},
    {"id": "depot", "node": "n0"},
    POSITION,
    True,
    NOW_NS,
    4,
    answer=PlanAcknowledgement(
        vehicle="van-a", time_ns=NOW_NS, cycle=1, accepted=False, reason="a flat tyre"
    ),
)


def test_what_is_stored_with_a_cycle_is_loaded(any_url, make_cycle):
    """Orders, vehicles and the plans in force come back as they were; others do not."""
    report, plans, states = make_cycle(1)
    orders = (make_order("s1"), make_order("s2", state="open", vehicle=None, cycle=None))
    with storage.open_database(any_url) as database:
        assert database.load_fleet(NOW_NS) == FleetRecords()
        records = FleetRecords(
            orders=orders, changes=tuple(map(change_of, orders)), vehicles=(VEHICLE,)
        )
        database.record_cycle(report, plans, states, records)
    with storage.open_database(any_url) as database:
        loaded = database.load_fleet(NOW_NS)
        assert (loaded.orders, loaded.vehicles) == (orders, (VEHICLE,))
        assert [(r.plan, r.status) for r in loaded.plans] == [(p, "published") for p in plans]
        lapsed = PlanRecord(plans[0], "lapsed", NOW_NS + 1, "not acknowledged in time")
        accepted = PlanRecord(plans[1], "acknowledged", NOW_NS + 2)
        database.save_fleet(FleetRecords(plans=(lapsed, accepted)))
        assert database.load_fleet(NOW_NS).plans == (lapsed, accepted)
        assert database.load_fleet(NOW_NS + DAY_NS).plans == (accepted,)


def test_a_plan_in_force_is_shown_until_a_later_one_is(any_url, make_cycle):
    """A vehicle that got none in the latest cycle still follows its last one."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        report, (first, second), states = make_cycle(1)
        database.record_cycle(report, (first, second), states)
        report, (later, _), states = make_cycle(2)
        database.record_cycle(report, (later,), states)
        assert tuple(r.plan for r in reader.latest_plan_records()) == (later, second)
        done = PlanRecord(second, "done", NOW_NS)
        database.save_fleet(FleetRecords(plans=(done,)))
        assert tuple(r.plan for r in reader.latest_plan_records()) == (later,)


@pytest.mark.slow
def test_sums_of_movements_add_up(any_url):
    """What is stored of a movement and hour is added to what is there."""
    first = MovementSum("a", "b", 8, 2.0, 0.5, 60.0, 1.0)
    other = MovementSum("a", "b", 9, 1.0, 0.25, 30.0, 0.0)
    with storage.open_database(any_url) as database:
        database.save_fleet(FleetRecords(movements=(first,)))
        database.save_fleet(FleetRecords(movements=(first, other)))
        assert database.load_fleet(NOW_NS).movements == (
            MovementSum("a", "b", 8, 4.0, 1.0, 120.0, 2.0),
            other,
        )


def test_sums_of_speeds_add_up(any_url):
    """What is stored of a segment and hour is added to what is there."""
    first, other = SpeedSum("a", 8, 2.0, 20.0, 3.0, 1.0), SpeedSum("a", 9, 1.0, 5.0)
    with storage.open_database(any_url) as database:
        database.save_fleet(FleetRecords(speeds=(first,)))
        database.save_fleet(FleetRecords(speeds=(first, other)))
        assert database.load_fleet(NOW_NS).speeds == (SpeedSum("a", 8, 4.0, 40.0, 6.0, 2.0), other)


def test_the_life_of_an_order_is_kept(any_url):
    """Each change is a row, in order, numbered on from transaction to transaction."""
    order = make_order("s1")
    steps = [
        replace(order, state=state, since_ns=NOW_NS + at, reason=f"step {at}")
        for at, state in enumerate(("open", "planned", "under_way", "served"))
    ]
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for some in (steps[:1], steps[1:3], steps[3:]):
            database.save_fleet(FleetRecords((some[-1],), tuple(map(change_of, some))))
        assert reader.order_changes("s1") == tuple(map(change_of, steps))
        assert reader.order_changes("s2") == ()
        assert reader.orders() == (steps[-1],)
        assert reader.orders(("open", "planned")) == ()


def test_the_life_of_a_plan_is_kept_as_long_as_the_plan(any_url, make_cycle):
    """Each change is a row, in order; those of a plan that is not stored are left out."""

    def change(vehicle: str, at: int, status: str, reason: str | None = None) -> PlanChange:
        return PlanChange(1, vehicle, NOW_NS + at, status, reason)

    def records(*some: PlanChange) -> FleetRecords:
        return FleetRecords(plan_changes=some)

    report, plans, states = make_cycle(1)
    own, other = (plan.vehicle for plan in plans)
    sent = [change(own, 0, "published"), change(other, 0, "published")]
    gone = PlanChange(7, own, NOW_NS, "lapsed", "a plan of another database")
    later = [change(own, 1, "acknowledged"), change(own, 2, "lapsed", "it did not leave")]
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(report, plans, states, records(gone, *sent))
        database.save_fleet(records(gone, *later))
        assert reader.plan_changes(own, [1, 7]) == (sent[0], *later)
        assert reader.plan_changes(other, [1, 7]) == (sent[1],)
        assert reader.plan_changes(own, [2]) == reader.plan_changes(own, []) == ()
        last, plans, states = make_cycle(2)
        last = last.model_copy(update={"started_ns": report.started_ns + 9 * DAY_NS})
        database.record_cycle(last, plans, states)
        database.trust_clock(last.started_ns)
        assert database.prune(7.0, last.started_ns) == 1
        with reader.tables() as tables:
            assert [row for rows in tables.rows("plan_changes") for row in rows] == []


def test_new_orders_are_added_all_or_none(any_url):
    """Without a look at what is there: an id that is stored already refuses them all."""
    orders = [replace(make_order(f"s{i}"), request={"id": f"s{i}", "n": 1}) for i in range(3)]

    def records(*some):
        return FleetRecords(some, tuple(map(change_of, some)))

    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.add_orders(records(*orders[:2]))
        with pytest.raises(storage.OrderKnownError):
            database.add_orders(records(orders[2], orders[1]))
        assert reader.orders() == tuple(orders[:2])
        assert reader.order_changes("s2") == ()
        later = replace(orders[0], state="planned", since_ns=NOW_NS + 9)
        database.save_fleet(records(later))
        assert reader.order_changes("s0") == (change_of(orders[0]), change_of(later))
        database.add_orders(records(orders[2]))
        assert len(reader.orders()) == 3


def test_an_ended_order_is_forgotten_only_when_no_file_has_it(any_url, make_cycle):
    """One that is still listed would be planned and delivered again."""
    old = NOW_NS - 9 * DAY_NS
    orders = (
        make_order("listed", state="served", since_ns=old),
        make_order("gone", state="served", since_ns=old, listed=False),
        make_order("gone-today", state="failed", since_ns=NOW_NS - DAY_NS // 2, listed=False),
        make_order("gone-yesterday", state="failed", since_ns=NOW_NS - 2 * DAY_NS, listed=False),
        make_order("under-way", state="under_way", since_ns=old, listed=False),
    )
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(*make_cycle(1), FleetRecords(orders, tuple(map(change_of, orders))))
        assert {o.order for o in database.load_fleet(NOW_NS).orders} == {
            "listed",
            "gone-today",
            "under-way",
        }
        lately = reader.orders(ended_since_ns=NOW_NS - DAY_NS)
        assert {o.order for o in lately} == {"gone-today", "under-way"}
        database.prune(7.0, NOW_NS)
        kept = {o.order for o in reader.orders()}
        assert kept == {"listed", "gone-today", "gone-yesterday", "under-way"}
        assert reader.order_changes("gone") == ()
