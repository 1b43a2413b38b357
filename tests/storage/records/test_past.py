"""The fleet at a moment of the kept past."""

from __future__ import annotations

from dataclasses import replace

import msgspec

import storage
from slipstream.orders import FleetRecords, OrderChange, OrderRecord, PlanRecord
from storage import CycleSums, OrderEnd, RollUpBuffer

S = 1_000_000_000
START_NS = 1_790_000_000 * S
PERIOD_NS = 30 * S
DAY_NS = 86_400 * S


def order(name: str, state: str, since_ns: int, **changes: object) -> OrderRecord:
    """An order as it is now."""
    record = OrderRecord(name, "n1", 60.0, 2, None, None, state, since_ns, "so", "van-a", 1)
    return replace(record, **changes)


def life(name: str, *steps: tuple[int, str]) -> tuple[OrderChange, ...]:
    """The changes of an order."""
    return tuple(OrderChange(name, at, state, "so", "van-a", 1) for at, state in steps)


def test_no_database_has_no_past(any_url):
    """Nothing is asked of what is not there."""
    with storage.open_reader(any_url) as reader:
        assert reader.span() is None
        assert reader.cycle_at(START_NS) is None
        assert (reader.plans_at(START_NS), reader.orders_at(START_NS)) == ((), ())
        assert reader.cycle_sums(0, START_NS) == CycleSums({}, 0.0, 0.0, 0)
        assert reader.last_energy(START_NS) is None
        assert (reader.order_ends(0, START_NS), reader.state_counts(0, START_NS)) == ((), {})


def test_cycles_are_found_by_time(any_url, make_cycle):
    """The first and last moment, the cycle of a moment, and what cycles of a range did."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for number in (1, 2, 3):
            report, plans, states = make_cycle(number)
            if number == 1:
                # Within rounding it saves nothing.
                as_much = {"cooperative_kwh": report.energy.baseline_kwh - 0.0004}
                energy = report.energy.model_copy(update=as_much)
                report = report.model_copy(update={"energy": energy})
            if number == 3:
                nothing = {"energy": None, "status": "failed", "plans": 0, "wall_s": 4.5}
                report, plans = report.model_copy(update=nothing), []
            database.record_cycle(report, plans, states)
        begins = [START_NS + number * PERIOD_NS for number in (1, 2, 3)]
        assert reader.span() == (begins[0], begins[2])
        assert [reader.cycle_at(begins[0] + step) for step in (-1, 0, PERIOD_NS)] == [None, 1, 2]
        assert reader.cycle_sums(begins[0], begins[2]) == CycleSums({"ok": 2}, 1.5, 1.5, 4, 1)
        whole = reader.cycle_sums(begins[0], begins[2] + 1)
        assert whole == CycleSums({"ok": 2, "failed": 1}, 2.5, 4.5, 4, 1)
        # The last cycle drove nothing: the figures of the one before stay.
        last = reader.last_energy(begins[2])
        assert last is not None
        assert last.cycle == 2
        assert reader.last_energy(begins[0] - 1) is None


def test_plans_are_those_of_the_moment(any_url, make_cycle):
    """The latest plan that had gone out, with what had become of it by then."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        sent = {}
        for number in (1, 2, 3):
            report, (first, second), states = make_cycle(number)
            plans = (first, second) if number < 3 else (first,)
            sent[number] = first, second
            database.record_cycle(report, plans, states)
        at = {number: START_NS + number * PERIOD_NS for number in (1, 2, 3)}
        (first_1, second_1), (first_2, second_2), (first_3, _) = sent[1], sent[2], sent[3]
        ends = (
            PlanRecord(first_1, "superseded", at[2], "by a later one"),
            PlanRecord(first_2, "superseded", at[3], "by a later one"),
            # It goes on by the plan of cycle 1.
            PlanRecord(second_2, "refused", at[2] + 5 * S, "too late"),
            PlanRecord(second_1, "done", at[3] + 5 * S),
        )
        database.save_fleet(FleetRecords(plans=ends))

        def found(time_ns: int) -> list[tuple[str, int, str]]:
            records = reader.plans_at(time_ns)
            return [(one.plan.vehicle, one.plan.cycle, one.status) for one in records]

        assert found(at[1] - 1) == []
        assert found(at[1]) == [("van-a", 1, "published"), ("van-b", 1, "published")]
        assert found(at[2] + S) == [("van-a", 2, "published"), ("van-b", 2, "published")]
        assert found(at[2] + 6 * S) == [("van-a", 2, "published"), ("van-b", 1, "published")]
        assert found(at[3] + 6 * S) == [("van-a", 3, "published"), ("van-b", 2, "refused")]
        assert reader.plans_at(at[3])[0].plan == first_3
        assert found(at[3] + 3 * DAY_NS) == []


def test_orders_are_those_of_the_moment(any_url):
    """State, vehicle and reason as they were; what ended long before is left out."""
    lives = {
        "early": ((0, "open"), (10, "planned"), (20, "served")),
        "late": ((30, "open"), (40, "planned"), (50, "failed")),
        "old": ((-8 * 86_400, "open"),),
    }
    records = FleetRecords(
        orders=tuple(
            order(name, steps[-1][1], START_NS + steps[-1][0] * S, pinned="van-b")
            for name, steps in lives.items()
        ),
        changes=tuple(
            change
            for name, steps in lives.items()
            for change in life(name, *((START_NS + at * S, state) for at, state in steps))
        ),
    )
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.save_fleet(records)

        def found(at: int, limit: int = 10) -> list[tuple[str, str]]:
            return [(o.order, o.state) for o in reader.orders_at(START_NS + at * S, limit)]

        assert found(5) == [("old", "open"), ("early", "open")]
        assert found(35) == [("old", "open"), ("early", "served"), ("late", "open")]
        assert found(60) == [("old", "open"), ("early", "served"), ("late", "failed")]
        assert found(60, limit=1) == [("late", "failed")]
        assert found(30 + 86_400) == [("old", "open"), ("late", "failed")]
        assert {o.pinned for o in reader.orders_at(START_NS + 60 * S)} == {None}
        assert reader.order_ends(START_NS, START_NS + 50 * S) == (
            OrderEnd("early", "served", START_NS + 20 * S, None),
        )
        assert len(reader.order_ends(START_NS, START_NS + 51 * S)) == 2


def test_states_are_counted_by_the_hour(any_url, make_cycle):
    """Hours that have ended, and the minutes of the present one."""
    _, _, (known, unknown) = make_cycle(1)
    hour_ns = START_NS // (3600 * S) * 3600 * S
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for minute in (0, 1, 61):
            buffer = RollUpBuffer()
            for state in (known, unknown, known):
                time_ns = hour_ns + minute * 60 * S
                buffer.add(msgspec.structs.replace(state, time_ns=time_ns))
            database.add_rollups(buffer.take())
        assert reader.state_counts(hour_ns, hour_ns + 3600 * S) == {
            known.segment: (4, 4),
            unknown.segment: (2, 0),
        }
        assert reader.state_counts(hour_ns, hour_ns + 7200 * S)[known.segment] == (6, 6)
