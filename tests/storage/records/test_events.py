"""Events and alarms: stored, brought up to date, found by time, deleted with the cycles."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

import storage
from storage.database import Database
from tests.storage.conftest import PAUSED, PERIOD_NS, RAISED, START_NS


def test_an_alarm_is_one_event_from_begin_to_end(any_url) -> None:
    """What is stored of it again takes its place; others get numbers of their own."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.save_events([RAISED, PAUSED])
        assert database.load_alarms(0) == (replace(RAISED, number=1),)
        seen = replace(RAISED, acknowledged_by="operator", acknowledged_ns=START_NS + 9)
        over = replace(seen, ended_ns=START_NS + 10, severity="critical")
        database.save_events([over, replace(RAISED, alarm="0b", time_ns=START_NS + 7)])
        assert [event.number for event in database.load_alarms(START_NS + 11)] == [3]
        assert [event.alarm for event in database.load_alarms(START_NS + 10)] == ["0a", "0b"]
        stored = reader.events(START_NS, START_NS + 100, limit=9)
        assert [event.number for event in stored] == [3, 2, 1]
        assert stored[1:] == (replace(PAUSED, number=2), replace(over, number=1))
        assert reader.events(START_NS + 1, START_NS + 7, limit=9) == (stored[1],)
        assert reader.events(0, 2**62, limit=1) == stored[:1]
        assert reader.events(0, 2**62, limit=9, before=2) == stored[2:]


def test_events_go_with_the_cycles(any_url, make_cycle) -> None:
    """Those before all cycles are deleted, but for alarms in force."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        over = replace(RAISED, alarm="0b", ended_ns=START_NS + 1)
        late = replace(PAUSED, time_ns=START_NS + 4 * PERIOD_NS)
        database.save_events([RAISED, over, PAUSED, late])
        for number in (3, 4):
            database.record_cycle(*make_cycle(number))
        database.tidy(START_NS + 5 * PERIOD_NS)
        kept = reader.events(0, 2**62, limit=9)
        assert [(event.alarm, event.kind) for event in kept] == [
            (None, "pause"),
            ("0a", "rsu_silent"),
        ]


def test_a_cycle_waits_for_other_writers_only_so_long(url, make_cycle, monkeypatch) -> None:
    """One whose turn does not come in time is a fault, and nothing of it is stored."""
    monkeypatch.setattr("storage.database.CYCLE_WITHIN_S", 0.05)
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        begun, over = threading.Event(), threading.Event()

        def write(database: Database) -> None:
            with database._write_session():
                begun.set()
                over.wait(30)

        other = threading.Thread(target=write, args=(database,))
        other.start()
        assert begun.wait(30)
        try:
            with pytest.raises(storage.StorageError, match=r"busy for 0\.05 s"):
                database.record_cycle(*make_cycle(1))
        finally:
            over.set()
            other.join()
        assert reader.latest_cycle() is None
        database.record_cycle(*make_cycle(1))
        assert reader.latest_cycle() == make_cycle(1)[0]


@pytest.mark.process
def test_a_cycle_waits_for_another_process_of_the_server_only_so_long(
    postgres_url, make_cycle, monkeypatch
) -> None:
    """The same where a command holds the server's lock, which SQLite ends by its busy timeout."""
    monkeypatch.setattr("storage.database.CYCLE_WITHIN_S", 0.2)
    with storage.open_database(postgres_url) as database:
        with (
            storage.open_database(postgres_url) as command,
            command._write_session(),
            pytest.raises(storage.StorageError, match="lock timeout"),
        ):
            database.record_cycle(*make_cycle(1))
        database.record_cycle(*make_cycle(1))
        assert database.next_cycle_number() == 2
