"""History is read where there is some; an unreadable database is shown and tried again."""

from __future__ import annotations

import pytest

import storage
from dashboard.feeds import HistoryFeed
from dashboard.live import HISTORY_CYCLES, LiveData
from slipstream.errors import InputError
from slipstream.orders import FleetRecords, OrderRecord
from slipstream.service import LogLimiter

S = 1_000_000_000


@pytest.fixture
def live(now_ns) -> LiveData:
    """Empty live data."""
    return LiveData(lambda: now_ns)


@pytest.mark.slow
def test_history_appears_with_the_database(tmp_path, live, world, now_ns):
    """A missing database is no problem; once the dispatcher writes, its cycles and plans show."""
    url = f"sqlite:///{tmp_path}/state/x.db"
    feed = HistoryFeed(url, live, LogLimiter())
    feed.refresh()
    assert live.snapshot().cycles == ()
    assert live.snapshot().history_problem is None
    with storage.open_database(url) as database:
        plans = [world.plan(van, 1, now_ns) for van in ("van-a", "van-b")]
        database.record_cycle(world.cycle(1, now_ns), plans, [])
        feed.refresh()
        assert [report.cycle for report in live.snapshot().cycles] == [1]
        assert live.snapshot().plans == {plan.vehicle: plan for plan in plans}
        database.record_cycle(world.cycle(2, now_ns + S), [], [])
    feed.refresh()
    assert [report.cycle for report in live.snapshot().cycles] == [1, 2]


@pytest.mark.slow
def test_an_order_that_has_not_changed_stays_the_same_object(tmp_path, live, now_ns):
    """So that its row is not made anew every few seconds; one that has changed is another."""
    url = f"sqlite:///{tmp_path}/x.db"
    feed = HistoryFeed(url, live, LogLimiter())

    def order(name, since_ns):
        return OrderRecord(name, "c2", 60.0, 0, None, None, "open", since_ns, "submitted")

    with storage.open_database(url) as database:
        database.save_fleet(FleetRecords((order("a", now_ns), order("b", now_ns))))
        feed.refresh()
        before = {one.order: one for one in live.snapshot().orders}
        database.save_fleet(FleetRecords((order("b", now_ns + S),)))
        feed.refresh()
    after = {one.order: one for one in live.snapshot().orders}
    assert before == {"a": order("a", now_ns), "b": order("b", now_ns)}
    assert after["a"] is before["a"]
    assert after["b"] == order("b", now_ns + S)


@pytest.mark.slow
def test_only_new_cycles_are_read(tmp_path, live, world, now_ns, monkeypatch):
    """After the first time only cycles since the last are read; all, where they count anew."""
    limits, whole = [], HISTORY_CYCLES
    cycles = storage.Reader.cycles

    def spied(self, limit, **options):
        limits.append(limit)
        return cycles(self, limit, **options)

    monkeypatch.setattr(storage.Reader, "cycles", spied)
    path = tmp_path / "x.db"
    feed = HistoryFeed(f"sqlite:///{path}", live, LogLimiter())
    with storage.open_database(f"sqlite:///{path}") as database:
        for number, read in ((5, [1, whole]), (6, [1, 1]), (None, [1]), (9, [1, 3])):
            if number is not None:
                database.record_cycle(world.cycle(number, now_ns + number * S), [], [])
            feed.refresh()
            assert limits == read
            limits.clear()
    assert [report.cycle for report in live.snapshot().cycles] == [5, 6, 9]
    path.unlink()
    with storage.open_database(f"sqlite:///{path}") as database:
        database.record_cycle(world.cycle(1, now_ns + 20 * S), [], [])
    feed.refresh()
    assert limits == [1, whole]


def test_an_unreadable_database_is_shown_and_retried(tmp_path, live, world, now_ns):
    """A file that is no database is named on the page until it is mended."""
    path = tmp_path / "x.db"
    path.write_bytes(b"no database" * 1000)
    feed = HistoryFeed(f"sqlite:///{path}", live, LogLimiter())
    feed.refresh()
    assert "not a database" in live.snapshot().history_problem
    path.unlink()
    with storage.open_database(f"sqlite:///{path}") as database:
        database.record_cycle(world.cycle(1, now_ns), [], [])
    feed.refresh()
    assert live.snapshot().history_problem is None
    assert len(live.snapshot().cycles) == 1


def test_a_bad_url_is_refused_at_the_start(live):
    """What is no database URL is a user's mistake."""
    with pytest.raises(InputError, match="not a database URL"):
        HistoryFeed("somewhere.db", live, LogLimiter())
