"""From conditions to alarms: raised, changed, ended, and one where a condition comes and goes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.service.alarms import KINDS, Condition
from dispatcher_daemon.service.alarms.book import (
    FEW,
    MANY,
    RESTART_S,
    TEXT_EVERY_S,
    TOLD_S,
    AlarmBook,
)
from slipstream.messages import MAX_ALARMS, Alarm

NOW_NS = 1_800_000_000_000_000_000
SILENT = Condition("rsu_silent", "rsu/a", "last heard of at noon")
NO_SIGNAL = Condition("rsu_no_signal", "rsu/a", "no picture")
END_S = KINDS["rsu_silent"].end_after_s


def at(book: AlarmBook, now_s: float, *conditions: Condition) -> tuple[Alarm, ...]:
    """What changes at a second."""
    return book.update(conditions, NOW_NS + round(now_s * 1e9), now_s)


def test_an_alarm_from_begin_to_end() -> None:
    """It is told of once, and its end is told once it has been gone for a while."""
    book = AlarmBook()
    (raised,) = at(book, 0, SILENT)
    assert (raised.kind, raised.severity, raised.since_ns) == ("rsu_silent", "warning", NOW_NS)
    assert (raised.ended_ns, raised.mend) == (None, KINDS["rsu_silent"].mend)
    assert at(book, 1, SILENT) == ()
    assert at(book, END_S) == ()
    (ended,) = at(book, 1 + END_S)
    assert ended.id == raised.id
    assert ended.ended_ns == NOW_NS + round((1 + END_S) * 1e9)
    assert book.alarms() == ((ended,), 0)
    assert book.in_force() == ()
    at(book, 2 + END_S + TOLD_S)
    assert book.alarms() == ((), 0)


def test_a_condition_has_to_last() -> None:
    """One that is over before is no alarm; the alarm dates from its begin."""
    book, wait_s = AlarmBook(), KINDS["rsu_no_signal"].raise_after_s
    assert at(book, 0, NO_SIGNAL) == ()
    assert at(book, 30) == ()
    assert at(book, 31, NO_SIGNAL) == ()
    assert at(book, 31 + wait_s - 1, NO_SIGNAL) == ()
    (raised,) = at(book, 31 + wait_s, NO_SIGNAL)
    assert raised.since_ns == NOW_NS + 31 * 10**9


@pytest.mark.slow
@given(st.lists(st.booleans(), max_size=300))
def test_one_that_flaps_is_one_alarm(seen: list[bool]) -> None:
    """However it comes and goes within the time that an ended one is told of."""
    book, ids = AlarmBook(), set()
    for second, is_there in enumerate(seen):
        ids |= {alarm.id for alarm in at(book, second, *([SILENT] if is_there else []))}
    assert len(ids) == any(seen)


def test_one_that_is_back_much_later_is_another_alarm() -> None:
    """Nobody has acknowledged that one."""
    book = AlarmBook()
    (first,) = at(book, 0, SILENT)
    assert book.acknowledge(first.id, "ada", NOW_NS) is not None
    at(book, 20)
    at(book, 21 + TOLD_S)
    (second,) = at(book, 22 + TOLD_S, SILENT)
    assert second.id != first.id
    assert second.acknowledged_by is None


def test_texts_and_severities_follow_the_condition() -> None:
    """A worse one at once, another text now and then."""
    book = AlarmBook()
    at(book, 0, SILENT)
    other = Condition("rsu_silent", "rsu/a", "another text")
    assert at(book, 1, other) == ()
    assert [alarm.text for alarm in at(book, TEXT_EVERY_S, other)] == ["another text"]
    worse = Condition("rsu_silent", "rsu/a", "bad", severity="critical")
    assert [alarm.severity for alarm in at(book, TEXT_EVERY_S + 1, worse)] == ["critical"]


def test_the_worst_come_first() -> None:
    """Those in force before ended ones, worse before lesser, later before earlier."""
    book = AlarmBook()
    at(book, 0, SILENT, Condition("database_set_aside", "database", "x"))
    late = Condition("rsu_silent", "rsu/b", "later")
    bad = Condition("database_fault", "database", "full")
    for second in (END_S, 1 + END_S):
        at(book, second, late, bad, Condition("database_nearly_full", "database", "y"))
    kinds = [(alarm.kind, alarm.subject) for alarm in book.alarms()[0]]
    assert kinds[:3] == [
        ("database_fault", "database"),
        ("rsu_silent", "rsu/b"),
        ("database_nearly_full", "database"),
    ]
    assert sorted(kinds[3:]) == [("database_set_aside", "database"), ("rsu_silent", "rsu/a")]


def test_many_of_a_kind_are_one_alarm() -> None:
    """Named as far as there is room; it stays until few are left, then each is one again."""
    book = AlarmBook()

    def silent(number: int) -> list[Condition]:
        return [Condition("rsu_silent", f"rsu/{n}", "silent", NOW_NS - n) for n in range(number)]

    assert [alarm.subject for alarm in at(book, 0, *silent(MANY))] == [
        f"rsu/{n}" for n in range(MANY)
    ]
    (raised,) = at(book, 1, *silent(12), Condition("rsu_silent", "rsu/3", "again"))
    assert (raised.subject, raised.since_ns) == ("dispatcher", NOW_NS - 11)
    assert raised.text == "12 RSUs are silent: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 2 more"
    ended = at(book, 1 + END_S, *silent(FEW + 1))
    assert {alarm.subject for alarm in ended} == {f"rsu/{n}" for n in range(MANY)}
    assert [alarm.subject for alarm in book.in_force()] == ["dispatcher"]
    assert {alarm.subject for alarm in at(book, 2 + END_S, *silent(FEW))} == {
        f"rsu/{n}" for n in range(FEW)
    }
    (over,) = at(book, 2 + 2 * END_S, *silent(FEW))
    assert over.id == raised.id
    assert len(book.in_force()) == FEW


def test_a_message_has_room_for_so_many() -> None:
    """The others are counted."""
    book = AlarmBook()
    each = [Condition("cycle_failed", f"{n}", "x") for n in range(MAX_ALARMS + 1)]
    at(book, 0, *each)
    alarms, more = book.alarms()
    assert (len(alarms), more) == (MAX_ALARMS, 1)


def test_alarms_of_the_run_before_stay() -> None:
    """Until facts have come in; then one whose condition is gone ends, the other one goes on."""
    book = AlarmBook()
    at(book, 0, SILENT, Condition("rsu_silent", "rsu/b", "silent"))
    before = book.in_force()
    again = AlarmBook(before, 1000.0)
    assert at(again, 1001) == ()
    assert at(again, 1000 + RESTART_S, SILENT) == ()
    (ended,) = at(again, 1001 + RESTART_S + END_S, SILENT)
    assert (ended.subject, ended.id) == ("rsu/b", before[1].id)
    assert [alarm.id for alarm in again.in_force()] == [before[0].id]


def test_the_first_who_acknowledges_stays() -> None:
    """Another id is nobody's."""
    book = AlarmBook()
    (raised,) = at(book, 0, SILENT)
    assert book.acknowledge("none", "ada", NOW_NS) is None
    first = book.acknowledge(raised.id, "ada", NOW_NS + 1)
    second = book.acknowledge(raised.id, "bob", NOW_NS + 2)
    assert first == second
    assert second is not None
    assert (second.acknowledged_by, second.acknowledged_ns) == ("ada", NOW_NS + 1)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_each_kind_says_what_to_do(kind: str) -> None:
    """In words, and its text is told anew more often than its end takes."""
    assert KINDS[kind].mend
    assert KINDS[kind].end_after_s <= TOLD_S
