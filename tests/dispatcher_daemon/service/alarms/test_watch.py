"""Alarms kept in a database, told on the bus, acknowledged, and the same after a restart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from prometheus_client import REGISTRY

from dispatcher_daemon.service.alarms import AlarmWatch, Condition
from dispatcher_daemon.service.alarms import watch as module
from slipstream.messages import Alarm, Alarms
from storage import Database, Event, StorageError, open_database, open_reader

SILENT = Condition("rsu_silent", "rsu/a/b", "last heard of at noon")
FULL = Condition("database_fault", "database", "disk full")


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    """An empty one."""
    with open_database(f"sqlite:///{tmp_path}/d.db") as found:
        yield found


def test_alarms_survive_a_restart(database: Database, tmp_path: Path) -> None:
    """With who has acknowledged them; the log has that, too."""
    before = AlarmWatch(database)
    before.update([SILENT, FULL])
    before.save()
    first, second = before.told().alarms
    assert (first.kind, second.kind) == ("database_fault", "rsu_silent")
    told = before.acknowledge(second.id, "ada", "page")
    assert told is not None
    assert before.acknowledge("none", "ada", "page") is None
    after = AlarmWatch(database)
    assert after.told().alarms == (first, told)
    assert told.acknowledged_by == "ada"
    again = after.acknowledge(second.id, "bob", "page")
    assert again == told
    with open_reader(f"sqlite:///{tmp_path}/d.db") as reader:
        log = reader.events(0, 2**62, limit=9)
    assert [(e.kind, e.subject, e.actor) for e in log] == [
        ("acknowledge", "rsu/a/b", "page"),
        ("database_fault", "database", None),
        ("rsu_silent", "rsu/a/b", None),
    ]


def test_alarms_are_told_at_each_change_and_now_and_then(
    database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On the bus, to callers of the API, and as metrics."""
    sent: list[Alarms] = []
    changes: list[Alarm] = []
    woken: list[int] = []
    watch = AlarmWatch(
        database, sent.append, changes.append, lambda names: woken.append(len(names))
    )
    watch.update([])
    assert [len(told.alarms) for told in sent] == [0]
    watch.update([SILENT])
    watch.update([SILENT])
    assert [len(told.alarms) for told in sent] == [0, 1]
    assert [alarm.subject for alarm in changes] == ["rsu/a/b"]
    assert woken
    assert REGISTRY.get_sample_value("slipstream_alarms", {"severity": "warning"}) == 1
    monkeypatch.setattr(module, "TELL_EVERY_S", 0.0)
    watch.update([SILENT])
    assert [len(told.alarms) for told in sent] == [0, 1, 1]
    assert Alarms.model_validate_json(sent[-1].to_bytes()) == sent[-1]


class Moody:
    """A store that can be away."""

    def __init__(self) -> None:
        self.away = False
        self.saved: list[Event] = []

    def save_events(self, changed: Sequence[Event]) -> None:
        """Keep them, or fail."""
        if self.away:
            raise StorageError("x.db: disk full")
        self.saved += changed

    def load_alarms(self, ended_ns: int) -> tuple[Event, ...]:
        """None."""
        return ()


def test_a_database_that_is_away_costs_no_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told all the same, and stored as soon as it can be; an acknowledgement is refused."""
    monkeypatch.setattr(module, "SAVE_AGAIN_S", 0.0)
    store, woken = Moody(), list[str]()
    watch = AlarmWatch(store, wake=woken.extend)
    store.away = True
    watch.update([FULL])
    watch.save()
    (alarm,) = watch.told().alarms
    with pytest.raises(StorageError):
        watch.acknowledge(alarm.id, "ada", "page")
    assert watch.told().alarms == (alarm,)
    store.away = False
    woken.clear()
    watch.update([FULL])
    assert woken == [alarm.id]
    watch.save()
    assert [event.alarm for event in store.saved] == [alarm.id]
    woken.clear()
    watch.update([FULL])
    assert woken == []
