"""What cycles were made from: stored with them, shared, and deleted by age of their own."""

from __future__ import annotations

import sqlite3

import pytest

import storage
from storage import CycleInputs, Part
from storage.records import inputs

DAY_NS = 86_400 * 10**9
ROADS = Part.of(b"roads " * 100)


def _of(number):
    return CycleInputs(b"record %d" % number, {"roads": ROADS, "fleet": Part.of(b"%d" % number)})


def _count(url, table):
    connection = sqlite3.connect(url.removeprefix("sqlite:///"))
    try:
        return connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
    finally:
        connection.close()


def test_inputs_are_stored_with_their_cycle_and_a_shared_part_once(url, make_cycle):
    """They come back byte for byte, and two cycles' common part is one row."""
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        for number in (1, 2):
            database.record_cycle(*make_cycle(number), made_from=_of(number))
        database.record_cycle(*make_cycle(3))
        found = reader.stored_cycle(2)
        assert (found.report, list(found.plans)) == make_cycle(2)[:2]
        assert found.inputs == _of(2)
        assert found.inputs.parts["roads"].content == b"roads " * 100
        assert reader.stored_cycle(3).inputs is None
        assert reader.stored_cycle(4) is None
        assert reader.plan(2, "van-a") == make_cycle(2)[1][0]
        assert reader.plan(2, "van-z") is None
    assert _count(url, "input_parts") == 3


def test_inputs_that_cannot_be_stored_leave_no_cycle(url, make_cycle):
    """All or nothing: the cycle's number is free afterwards."""
    broken = CycleInputs(b"record", {"roads": Part("x" * 64, None)})
    with storage.open_database(url) as database:
        with pytest.raises(ValueError, match="refused"):
            database.record_cycle(*make_cycle(1), made_from=broken)
        assert database.next_cycle_number() == 1


@pytest.mark.slow
@pytest.mark.parametrize("budget_s", [None, 60.0])
def test_inputs_go_after_their_own_days_and_the_cycles_stay(url, make_cycle, budget_s):
    """Of 50 cycles six hours apart those of the last week keep theirs; unused parts are gone."""
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        for number in range(1, 51):
            report, plans, states = make_cycle(1)
            plans = [plan.model_copy(update={"cycle": number}) for plan in plans]
            report = report.model_copy(update={"cycle": number, "started_ns": number * DAY_NS // 4})
            database.record_cycle(report, plans, states, made_from=_of(number))
        database.tidy(50 * DAY_NS // 4, budget_s=budget_s)
        kept = [n for n in range(1, 51) if reader.stored_cycle(n).inputs is not None]
        assert kept == list(range(50 - round(4 * inputs.KEEP_DAYS), 51))
    assert _count(url, "cycles") == 50
    assert _count(url, "input_parts") == len(kept) + 1
    assert _count(url, "input_uses") == 2 * len(kept)


def test_a_deleted_cycle_takes_its_inputs_along(url, make_cycle):
    """Also their parts, unless another cycle has them."""
    with storage.open_database(url) as database:
        for number in (1, 2):
            database.record_cycle(*make_cycle(number), made_from=_of(number))
        database.prune(0.0, make_cycle(2)[0].started_ns + DAY_NS)
    assert (_count(url, "cycle_inputs"), _count(url, "input_parts")) == (1, 2)


def test_a_damaged_part_is_told_and_never_used(url, make_cycle):
    """Another content under its hash, or none that can be unpacked, is one line."""
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(1), made_from=_of(1))
    for data in (Part.of(b"other").data, b"\x00\x01"):
        connection = sqlite3.connect(url.removeprefix("sqlite:///"))
        connection.execute("UPDATE input_parts SET data = ? WHERE hash = ?", (data, ROADS.hash))
        connection.commit()
        connection.close()
        with storage.open_reader(url) as reader:
            part = reader.stored_cycle(1).inputs.parts["roads"]
        with pytest.raises(ValueError, match="damaged"):
            _ = part.content
