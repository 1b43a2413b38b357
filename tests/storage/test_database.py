"""The writer: round trips, atomic cycles, numbering, pruning, and one clear line for bad files."""

from __future__ import annotations

import sqlite3
import threading
from pathlib import Path

import pytest
from sqlalchemy import event, text
from sqlalchemy.exc import OperationalError

import storage
from slipstream.errors import InputError
from slipstream.messages import CycleReport, DrivingAdvice, Unserved
from storage.engine import parse_url, writer_engine

DAY_NS = 86_400_000_000_000


def _file_of(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///"))


def _count(url: str, table: str) -> int:
    connection = sqlite3.connect(_file_of(url))
    try:
        return int(connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0])
    finally:
        connection.close()


def test_round_trip(any_url, make_cycle):
    """Reports, plans and states come back equal to what was recorded, field by field."""
    first, second = make_cycle(1), make_cycle(2)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(*first)
        database.record_cycle(*second)
        assert reader.cycles(limit=10) == (first[0], second[0])
        assert reader.latest_cycle() == second[0]
        assert tuple(r.plan for r in reader.latest_plan_records()) == tuple(second[1])
        assert reader.states(1) == tuple(first[2])


def test_a_thousand_unserved_stops_round_trip(any_url, make_cycle):
    """A cycle that serves next to nothing of a city is stored with each stop, in their order."""
    report, plans, states = make_cycle(1)
    stops = tuple(
        Unserved(stop=f"stop-{n}", reason=f"its window closes {n} s before anyone arrives")
        for n in range(1000, 0, -1)
    )
    report = report.model_copy(update={"unserved": stops})
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(report, plans, states)
        assert reader.latest_cycle() == report


def test_failed_cycle_round_trip(any_url, make_cycle):
    """A cycle without energy, solver or plans is stored as such; older plans stay the latest."""
    report, plans, _ = make_cycle(1)
    failed = CycleReport(
        cycle=2,
        started_ns=report.started_ns + 1,
        wall_s=0.1,
        status="failed",
        reason="no orders",
        solver=None,
        objective_kwh=None,
        variables=0,
        solvers=(),
        gates=(),
        energy=None,
        plans=0,
    )
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(report, plans, [])
        database.record_cycle(failed, [], [])
        assert reader.latest_cycle() == failed
        assert tuple(r.plan for r in reader.latest_plan_records()) == tuple(plans)


def test_a_fault_in_the_middle_leaves_nothing(url, make_cycle):
    """A cycle whose last table cannot be written leaves no row in any table."""
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(1))

        @event.listens_for(database._engine, "before_cursor_execute", retval=True)
        def _break_the_last_table(_c, _cursor, statement, parameters, _context, _many):
            if statement.startswith("INSERT INTO cycle_traffic"):
                statement = statement.replace("cycle_traffic", "no_such_table")
            return statement, parameters

        with pytest.raises(storage.StorageError, match="no such table"):
            database.record_cycle(*make_cycle(2))
        event.remove(database._engine, "before_cursor_execute", _break_the_last_table)
        for table, rows in (("cycles", 1), ("plans", 2), ("solver_runs", 2), ("cycle_traffic", 1)):
            assert _count(url, table) == rows
        database.record_cycle(*make_cycle(2))
        assert _count(url, "cycle_traffic") == 2


@pytest.mark.slow
def test_numbers_go_on(any_url, make_cycle):
    """Cycle numbers start at 1 and go on above the highest stored one after a restart."""
    with storage.open_database(any_url) as database:
        assert database.next_cycle_number() == 1
        database.record_cycle(*make_cycle(1))
        database.record_cycle(*make_cycle(7))
    with storage.open_database(any_url) as database:
        assert database.next_cycle_number() == 8


def test_a_cycle_is_recorded_once(any_url, make_cycle):
    """A number that is taken, and plans of another cycle, are refused and change nothing."""
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(*make_cycle(1))
        with pytest.raises(ValueError, match="cycle 1 is refused"):
            database.record_cycle(*make_cycle(1))
        with pytest.raises(ValueError, match="another cycle"):
            database.record_cycle(make_cycle(2)[0], make_cycle(3)[1], [])
        assert [cycle.cycle for cycle in reader.cycles(limit=9)] == [1]


def test_prune_in_batches(url, make_cycle, monkeypatch):
    """Old cycles go with all that hangs under them; newer ones and the very latest stay."""
    monkeypatch.setattr("storage.retention.PRUNE_BATCH", 3)
    with storage.open_database(url) as database:
        for number in range(1, 11):
            database.record_cycle(*make_cycle(number))
        now_ns = make_cycle(8)[0].started_ns + DAY_NS
        assert database.prune(keep_days=1.0, now_ns=now_ns) == 7
        assert database.prune(keep_days=1.0, now_ns=now_ns) == 0
        for table, rows in (("plans", 6), ("solver_runs", 6), ("cycle_traffic", 3)):
            assert _count(url, table) == rows
        assert database.prune(keep_days=0.0, now_ns=now_ns + DAY_NS) == 2
        assert database.next_cycle_number() == 11


@pytest.mark.parametrize("keep_days", [-1.0, float("nan"), float("inf"), float("-inf")])
def test_prune_refuses_ages_that_are_none(url, make_cycle, keep_days):
    """A limit that is negative or no number is refused by its name and deletes nothing."""
    with storage.open_database(url) as database:
        for number in (1, 2):
            database.record_cycle(*make_cycle(number))
        with pytest.raises(InputError, match="no number of days") as caught:
            database.prune(keep_days=keep_days, now_ns=2**62)
        assert caught.value.key == "keep_days"
        assert database.prune(keep_days=1e300, now_ns=make_cycle(2)[0].started_ns) == 0
    assert _count(url, "cycles") == 2


@pytest.mark.slow
def test_prune_can_be_limited(any_url, make_cycle, monkeypatch):
    """A limited prune deletes the oldest so many, over several batches, and leaves the rest."""
    monkeypatch.setattr("storage.retention.PRUNE_BATCH", 3)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        for number in range(1, 11):
            database.record_cycle(*make_cycle(number))
        database.trust_clock(2**62)
        for limit, deleted, first in ((4, 4, 5), (3, 3, 8), (9, 2, 10)):
            assert database.prune(0.0, 2**62, limit=limit) == deleted
            assert reader.cycles(limit=10)[0].cycle == first


@pytest.mark.slow
def test_reading_while_writing(url, make_cycle):
    """A reader beside a busy writer sees only whole cycles and never an error."""
    with storage.open_database(url) as database, storage.open_reader(url) as reader:
        done = threading.Event()

        def write() -> None:
            for number in range(1, 61):
                database.record_cycle(*make_cycle(number))
            done.set()

        writer = threading.Thread(target=write)
        writer.start()
        seen = 0
        while not done.is_set():
            latest = reader.latest_cycle()
            if latest is not None:
                assert latest == make_cycle(latest.cycle)[0]
                assert latest.cycle >= seen
                seen = latest.cycle
                assert len(reader.states(latest.cycle)) == 2
        writer.join()
        assert reader.latest_cycle() == make_cycle(60)[0]


def test_writer_connections_are_durable(url):
    """The writer runs in WAL mode with synchronous FULL and checks foreign keys."""
    storage.open_database(url).close()
    with writer_engine(parse_url(url)).connect() as connection:
        assert connection.scalar(text("PRAGMA journal_mode")) == "wal"
        assert connection.scalar(text("PRAGMA synchronous")) == 2
        assert connection.scalar(text("PRAGMA foreign_keys")) == 1


def test_readers_cannot_write(url):
    """A reader's connection refuses to write."""
    storage.open_database(url).close()
    with (
        storage.open_reader(url) as reader,
        reader._engine.connect() as connection,
        pytest.raises(OperationalError, match="readonly"),
    ):
        connection.execute(text("DELETE FROM cycles"))


def _not_a_database(path: Path) -> None:
    path.write_text("Dear diary, today the vans drove in a platoon.\n" * 100)


def _truncated(path: Path) -> None:
    storage.open_database(f"sqlite:///{path}").close()
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2)


def _newer(path: Path) -> None:
    storage.open_database(f"sqlite:///{path}").close()
    _execute(path, "UPDATE alembic_version SET version_num = '9999'")


def _another_programs(path: Path) -> None:
    _execute(path, "CREATE TABLE bookmarks (page TEXT)")


def _execute(path: Path, statement: str) -> None:
    connection = sqlite3.connect(path)
    connection.execute(statement)
    connection.commit()
    connection.close()


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (_not_a_database, "file is not a database"),
        (_truncated, "malformed"),
        (_newer, "newer Slipstream .schema 9999, known up to"),
        (_another_programs, "another program's tables .bookmarks"),
        (Path.mkdir, "is a directory"),
    ],
)
def test_bad_files(tmp_path, make, line):
    """A file that cannot be our database is refused in one line that names it, and left alone."""
    path = tmp_path / "slipstream.db"
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(InputError, match=line) as caught:
        storage.open_database(f"sqlite:///{path}")
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)
    if before is not None:
        assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("url", "line"),
    [
        ("sqlite:////proc/slipstream/x.db", "cannot make this folder"),
        ("sqlite:////proc/slipstream.db", "unable to open database file"),
        ("sqlite://", "names no file"),
        ("sqlite:///:memory:", "names no file"),
        ("slipstream.db", "not a database URL"),
        ("oracle9://host/name", "no driver"),
    ],
)
def test_bad_urls(url, line):
    """A URL that leads nowhere is refused in one line."""
    with pytest.raises(InputError, match=line):
        storage.open_database(url)


def test_opening_without_creating(url, tmp_path, make_cycle):
    """With ``create=False`` only a database that is there is opened, and nothing is made."""
    empty = tmp_path / "empty.db"
    empty.touch()
    for address, line in ((url, "no such file"), (f"sqlite:///{empty}", "holds no Slipstream")):
        with pytest.raises(InputError, match=line):
            storage.open_database(address, create=False)
    assert not _file_of(url).parent.exists()
    assert empty.stat().st_size == 0
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(1))
    with storage.open_database(url, create=False) as database:
        assert database.next_cycle_number() == 2


def test_faults_of_the_moment_are_one_line():
    """A database that cannot be written now is an I/O fault of one line, nobody's bad input."""
    error = storage.StorageError("/x.db: database or disk\n is full")
    assert isinstance(error, OSError)
    assert not isinstance(error, InputError)
    assert str(error) == "/x.db: database or disk is full"


def test_locked_by_another_writer(url, monkeypatch):
    """A database that another program keeps locked is refused after the busy timeout."""
    storage.open_database(url).close()
    monkeypatch.setattr("storage.engine.BUSY_TIMEOUT_MS", 100)
    other = sqlite3.connect(_file_of(url), isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    try:
        with pytest.raises(InputError, match="database is locked; stop the other program"):
            storage.open_database(url)
    finally:
        other.close()
    storage.open_database(url).close()


def test_plans_keep_their_advice(any_url, make_cycle):
    """How to drive is stored with where to drive."""
    report, plans, states = make_cycle(1)
    advice = DrivingAdvice(eco_approach=True, coasting_budget=0.06)
    advised = tuple(plan.model_copy(update={"advice": advice}) for plan in plans)
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(report, advised, states)
        assert {plan.advice for plan in tuple(r.plan for r in reader.latest_plan_records())} == {
            advice
        }
