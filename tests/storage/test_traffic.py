"""Gates and states in little room: the past of every segment."""

from __future__ import annotations

import msgspec
import pytest

import storage
from dispatcher_daemon.service import store
from slipstream.messages import Estimate
from storage import RollUp, RollUpBuffer, upkeep
from storage.traffic import rollup_table
from storage.traffic.models import FEATURES
from storage.traffic.rollups import HOUR_S, MAX_MINUTES, MINUTE_S, Spread, begin, merge

MINUTE_NS = 60 * 10**9
HOUR_NS = 60 * MINUTE_NS
DAY_NS = 24 * HOUR_NS
START_NS = 1_790_000_000 * 10**9 // HOUR_NS * HOUR_NS
"""On the hour."""


def _rollup(state, period_s=MINUTE_S):
    """The roll-up of one state."""
    spreads = {}
    if state.features is not None:
        for name in FEATURES:
            estimate = getattr(state.features, name)
            if estimate is not None:
                spreads[name] = Spread(estimate.value, estimate.value, estimate.value)
    return RollUp(
        segment=state.segment,
        period_s=period_s,
        began_ns=begin(state.time_ns, period_s),
        count=1,
        stable=int(state.y_e == 1),
        turbulent=int(state.y_e == 0),
        measured=int(state.features is not None),
        gaps=int("mean_gap_m" in spreads),
        vehicles_mean=state.vehicles,
        vehicles_max=state.vehicles,
        features=spreads,
    )


def _gate(report, name, *, is_open):
    return report.gates[0].model_copy(
        update={
            "segment": name,
            "y_e": int(is_open),
            "open": is_open,
            "reason": None if is_open else "turbulent",
        }
    )


def _cycle(cycle, number, started_ns, gates):
    """A cycle of a number and time with these gates, open or not, by segment."""
    report, plans, states = cycle
    told = tuple(_gate(report, name, is_open=is_open) for name, is_open in sorted(gates.items()))
    return (
        report.model_copy(update={"cycle": number, "started_ns": started_ns, "gates": told}),
        [plan.model_copy(update={"cycle": number}) for plan in plans],
        [msgspec.structs.replace(states[0], segment=name) for name in sorted(gates)],
    )


def _state(cycle, segment, time_ns, speed_mps, y_e=1):
    """A measured state with a speed."""
    state = cycle[2][0]
    features = msgspec.structs.replace(state.features, mean_speed_mps=Estimate(value=speed_mps))
    return msgspec.structs.replace(
        state, segment=segment, time_ns=time_ns, features=features, y_e=y_e
    )


def _unknown(cycle, segment, time_ns):
    return msgspec.structs.replace(cycle[2][1], segment=segment, time_ns=time_ns)


def _open(gates):
    return {gate.segment: gate.open for gate in gates}


@pytest.mark.slow
def test_the_gates_of_every_cycle_that_is_kept(any_url, make_cycle):
    """Recent ones are whole; older ones say what was open and why not, from changes alone; a
    segment that nobody watches any more has no gate.
    """
    shown = [
        {"a": True, "b": True},
        {"a": True, "b": False},
        {"a": True, "b": False},
        {"b": True},
        {"a": False, "b": True},
    ]
    times = [START_NS + number * HOUR_NS for number in range(5)]
    cycles = [
        _cycle(make_cycle(1), number, times[number - 1], gates)
        for number, gates in enumerate(shown, start=1)
    ]
    with storage.open_database(any_url) as database:
        for cycle in cycles[:3]:
            database.record_cycle(*cycle)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for cycle in cycles[3:]:
            database.record_cycle(*cycle)
        assert reader.cycles(9) == tuple(report for report, _, _ in cycles)
        only_last = reader.cycles(9, gates=False)
        assert [len(report.gates) for report in only_last] == [0, 0, 0, 0, 2]
        # Two hours more than states are kept after the second cycle.
        database.trust_clock(times[4])
        database.tidy(times[1] + round(upkeep.STATES_KEPT_H * HOUR_NS) + 1)
        stored = reader.cycles(9)
        assert [_open(report.gates) for report in stored] == shown
        assert stored[1].gates[1].reason == "turbulent"
        assert stored[1].gates[1].speed_mps is None
        assert stored[2:] == tuple(report for report, _, _ in cycles[2:])
        assert [len(reader.states(number)) for number in range(1, 6)] == [0, 0, 2, 1, 2]
        for moment, gates in zip(times, shown, strict=True):
            assert _open(part.gate for part in reader.segments_at(moment + 1)) == gates
        assert reader.segments_at(times[0] - 1) == ()
        # Cycles go, and with them the changes that none of those that stay needs.
        assert database.prune(0.0, times[2]) == 2
        database.tidy(times[4])
        assert [_open(report.gates) for report in reader.cycles(9)] == shown[2:]
        with database._write_session() as session:
            changes = session.connection().exec_driver_sql("SELECT count(*) FROM gate_changes")
            assert changes.scalar() == 5


def test_changes_of_a_cycle_that_was_not_stored_are_not_missed(url, make_cycle, monkeypatch):
    """After a fault the next cycle's changes are told from what is stored."""
    from storage.traffic import recent

    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        database.record_cycle(*_cycle(make_cycle(1), 1, START_NS, {"a": True}))
        with monkeypatch.context() as patch:
            patch.setattr(recent, "save", lambda *_: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                database.record_cycle(*_cycle(make_cycle(1), 2, START_NS + 1, {"a": False}))
        database.record_cycle(*_cycle(make_cycle(1), 3, START_NS + 2, {"a": False}))
        database.trust_clock(START_NS + 9 * DAY_NS)
        database.record_cycle(*_cycle(make_cycle(1), 4, START_NS + 9 * DAY_NS, {"a": False}))
        database.tidy(START_NS + 9 * DAY_NS)
        assert [_open(report.gates)["a"] for report in reader.cycles(9)] == [True, False, False]


@pytest.mark.slow
def test_rollups_are_those_of_all_states(any_url, make_cycle):
    """Minutes and hours have counts, shares, mean and extremes, however states come: in several
    goes, late, or from a run before.
    """
    cycle = make_cycle(1)
    states = [
        _state(cycle, "a", START_NS + 1, 10.0),
        _state(cycle, "a", START_NS + 2, 20.0, y_e=0),
        _unknown(cycle, "a", START_NS + 3),
        _state(cycle, "a", START_NS + MINUTE_NS, 5.0),
        _state(cycle, "b", START_NS + 2, 7.0),
    ]
    late = _state(cycle, "a", START_NS + 4, 30.0)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        assert reader.rollups("a", 0, 2**62) == ()
        buffer = RollUpBuffer()
        for state in states:
            buffer.add(state)
        # The second minute has not ended.
        database.add_rollups(buffer.take(START_NS + MINUTE_NS + 11 * 10**9))
        assert len(reader.rollups("a", 0, 2**62)) == 1
        database.add_rollups(buffer.take())
        assert reader.rollups("a", 0, 2**62, period_s=HOUR_S) == ()
        # A state of the next hour ends this one, and one that comes late is counted in.
        for state in (_state(cycle, "b", START_NS + HOUR_NS, 7.0), late):
            buffer.add(state)
            database.add_rollups(buffer.take())
        first, second = reader.rollups("a", START_NS, START_NS + HOUR_NS)
        (hour,) = reader.rollups("a", 0, 2**62, period_s=HOUR_S)
        assert (first.count, first.stable, first.turbulent, first.measured) == (4, 2, 1, 3)
        assert first.stable_share == 0.5
        assert first.features["mean_speed_mps"] == pytest.approx((20.0, 10.0, 30.0))
        assert second.began_ns == START_NS + MINUTE_NS
        assert hour.count == 5
        assert hour.features["mean_speed_mps"] == pytest.approx((16.25, 5.0, 30.0))
        assert "mean_gap_m" not in hour.features
        expected = merge([_rollup(state, HOUR_S) for state in [*states[:4], late]])
        for name, spread in expected.features.items():
            assert hour.features[name] == pytest.approx(spread, rel=1e-6)
        assert hour.vehicles_mean == expected.vehicles_mean
        # The range is open at its end; a moment shows its minute, later ones the hour.
        assert reader.rollups("a", START_NS + 1, START_NS + MINUTE_NS) == ()
        database.record_cycle(*_cycle(cycle, 1, START_NS, {"a": True, "b": False}))
        shown = {part.gate.segment: part.rollup for part in reader.segments_at(START_NS + 5)}
        assert shown["a"] == first
        assert shown["b"].features["mean_speed_mps"].mean == pytest.approx(7.0)
        assert shown["b"].began_ns == START_NS
        now_ns = START_NS + MINUTE_NS + round(upkeep.MINUTES_KEPT_H * HOUR_NS)
        database.tidy(now_ns)
        assert reader.rollups("a", 0, 2**62) == (second,)
        assert reader.segments_at(START_NS + 5)[0].rollup == hour


def test_the_last_hour_before_a_pause_is_kept(any_url, make_cycle):
    """Its minutes go after two days without a state: the hour is made of all of them, for good."""
    cycle = make_cycle(1)
    minutes = [_rollup(_state(cycle, "a", START_NS + n * MINUTE_NS, 9.0)) for n in range(4)]
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(*_cycle(cycle, 1, START_NS, {"a": True}))
        database.add_rollups(minutes)
        database.tidy(START_NS + 2 * DAY_NS + 2 * MINUTE_NS)
        assert len(reader.rollups("a", 0, 2**62)) == 2
        for _ in range(2):
            (hour,) = reader.rollups("a", 0, 2**62, period_s=HOUR_S)
            assert (hour.began_ns, hour.count) == (START_NS, 4)
            database.add_rollups([_rollup(_state(cycle, "a", START_NS + 3 * DAY_NS, 9.0))])


def test_no_value_is_beyond_what_a_column_takes(any_url, make_cycle):
    """Values near 0 are 0 and huge ones the largest; means of them can be stored, too."""
    cycle = make_cycle(1)
    parts = [
        _rollup(_state(cycle, name, START_NS + hour * HOUR_NS, speed))
        for hour in range(2)
        for name, speed in (("tiny", 1e-50), ("huge", 1e300), ("small", -2e-37))
    ]
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.add_rollups(parts)
        for period_s in (MINUTE_S, HOUR_S):
            shown = {
                name: reader.rollups(name, 0, 2**62, period_s=period_s)[0]
                for name in ("tiny", "huge", "small")
            }
            means = {name: part.features["mean_speed_mps"].mean for name, part in shown.items()}
            expected = {"tiny": 0.0, "huge": 3e38, "small": -2e-37}
            assert means == pytest.approx(expected, rel=1e-6, abs=0.0)


def test_hours_go_with_the_cycles(any_url, make_cycle):
    """A roll-up that ended before the first cycle that is kept goes; the others stay."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for number in range(1, 6):
            time_ns = START_NS + number * HOUR_NS
            database.record_cycle(*_cycle(make_cycle(1), number, time_ns, {"a": True}))
            buffer = RollUpBuffer()
            buffer.add(_state(make_cycle(1), "a", time_ns, 9.0))
            database.add_rollups(buffer.take())
        now_ns = START_NS + 5 * HOUR_NS
        database.prune(2.5 / 24, now_ns)
        database.tidy(now_ns)
        hours = reader.rollups("a", 0, 2**62, period_s=HOUR_S)
        assert [part.began_ns for part in hours] == [START_NS + n * HOUR_NS for n in (3, 4)]


def test_rollups_that_cannot_be_stored_are_kept_for_an_hour(make_cycle):
    """What is given back is taken again with what has come meanwhile; only too old ones go."""
    cycle = make_cycle(1)
    buffer = RollUpBuffer()
    for first, last, dropped in ((0, MAX_MINUTES, 0), (MAX_MINUTES, MAX_MINUTES + 10, 10)):
        for minute in range(first, last):
            buffer.add(_state(cycle, "a", START_NS + minute * MINUTE_NS, 9.0))
        taken = buffer.take()
        assert len(taken) == last
        assert buffer.give_back(taken) == dropped
    buffer.add(_state(cycle, "b", START_NS, 9.0))
    again = buffer.take()
    assert len(again) == MAX_MINUTES + 1
    assert {part.period_s for part in again} == {MINUTE_S}
    assert buffer.take() == []


def test_minutes_that_nobody_takes_are_bounded(make_cycle):
    """The oldest go, and one that is older than all of them does not come in."""
    buffer = RollUpBuffer()
    for minute in [*range(1, MAX_MINUTES + 10), 0]:
        buffer.add(_state(make_cycle(1), "a", START_NS + minute * MINUTE_NS, 9.0))
    taken = [(part.began_ns - START_NS) // MINUTE_NS for part in buffer.take()]
    assert taken == list(range(10, MAX_MINUTES + 10))


def test_nothing_is_known_in_failed_cycles_and_outages(any_url, make_cycle):
    """A gate that was open does not stay open for good: not in the list, not at a moment."""
    cycle = make_cycle(1)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        failed, _, _ = _cycle(cycle, 2, START_NS + MINUTE_NS, {})
        database.record_cycle(*_cycle(cycle, 1, START_NS, {"a": True}))
        database.record_cycle(failed.model_copy(update={"status": "failed"}), [], [])
        database.record_cycle(*_cycle(cycle, 3, START_NS + DAY_NS, {"a": True}))
        for _ in range(2):
            assert [_open(report.gates) for report in reader.cycles(9)] == [
                {"a": True},
                {},
                {"a": True},
            ]
            for minutes, is_open in ((2, True), (14, True), (16, False)):
                (part,) = reader.segments_at(START_NS + minutes * MINUTE_NS)
                assert part.gate.open == is_open
            assert (part.gate.y_e, part.gate.reason) == (None, "stale")
            database.tidy(START_NS + DAY_NS + 2 * MINUTE_NS)


def test_each_kind_of_old_traffic_has_its_turn(url, make_cycle, monkeypatch):
    """However little the time: minutes, which there are most of, keep nothing else from going."""
    monkeypatch.setattr(rollup_table, "ROWS_A_STEP", 1)
    cycle = make_cycle(1)
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        buffer = RollUpBuffer()
        for minute in range(30):
            buffer.add(_state(cycle, "a", START_NS + minute * MINUTE_NS, 9.0))
        database.add_rollups(buffer.take())
        for number in (1, 2):
            database.record_cycle(*_cycle(cycle, number, START_NS, {"a": True}))
        for _ in range(5):
            database.tidy(START_NS + 3 * DAY_NS, budget_s=0.0)
        assert reader.states(1) == ()
        assert len(reader.rollups("a", 0, 2**62)) == 29


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("catch_up_s", "left"), [(0.0, 40), (1.0, 9)], ids=["once", "in calls"])
def test_deletion_keeps_up_where_a_call_has_time_for_one_step(
    url, make_cycle, monkeypatch, catch_up_s, left
):
    """On a machine on which each step takes all the time of a call, three minutes go in a step,
    one kind of five in a call, and five minutes come in each cycle.
    """
    monkeypatch.setattr(rollup_table, "ROWS_A_STEP", 3)
    monkeypatch.setattr(upkeep, "MINUTES_KEPT_H", 1 / 15)
    monkeypatch.setattr(store, "TIDY_S", 0.0)
    monkeypatch.setattr(store, "CATCH_UP_S", catch_up_s)
    cycle = make_cycle(1)
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        buffer = RollUpBuffer()
        for number in range(1, 11):
            now_ns = START_NS + 5 * number * MINUTE_NS
            for minute in range(5):
                buffer.add(_state(cycle, "a", now_ns + (minute - 5) * MINUTE_NS, 9.0))
            database.add_rollups(buffer.take())
            database.record_cycle(*_cycle(cycle, number, now_ns, {"a": True}))
            store.delete_old_traffic(database.tidy, now_ns)
        minutes = len(reader.rollups("a", 0, 2**62))
        assert minutes >= left if catch_up_s == 0.0 else minutes <= left
        assert not database.tidy(now_ns)
