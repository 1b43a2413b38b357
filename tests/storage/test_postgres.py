"""What holds for a PostgreSQL server only: its locks, cut connections, a restart."""

from __future__ import annotations

import json
import os

import pytest
from sqlalchemy import event

import storage
from slipstream.errors import InputError

DAY_NS = 86_400_000_000_000
pytestmark = [pytest.mark.process, pytest.mark.slow]


@pytest.mark.attack
def test_one_dispatcher_owns_a_database_of_a_server(postgres, postgres_url, make_cycle):
    """A second one is refused; a lost lock costs cycles until the next opening; ages are kept."""
    with storage.open_database(postgres_url, owned=True) as database:
        for number in range(1, 11):
            database.record_cycle(*make_cycle(number))
        with pytest.raises(InputError, match="another dispatcher"):
            storage.open_database(postgres_url, owned=True)
        with (
            storage.headroom(postgres_url),
            storage.open_database(postgres_url, create=False) as command,
        ):
            assert command.prune(0.0, make_cycle(5)[0].started_ns) == 4
            assert command.trim(1000.0) == 0
            command.shrink()
        with pytest.raises(storage.UntrustedClockError):
            database.prune(90.0, make_cycle(10)[0].started_ns + 400 * DAY_NS)
        postgres.cut_sessions(postgres_url)
        with pytest.raises(storage.StorageError, match="connection that held its lock"):
            database.record_cycle(*make_cycle(11))
        assert database.next_cycle_number() == 11
        database.record_cycle(*make_cycle(12))
        with pytest.raises(InputError, match="another dispatcher"):
            storage.open_database(postgres_url, owned=True)
    storage.open_database(postgres_url, owned=True).close()
    with storage.open_reader(postgres_url) as reader:
        assert [report.cycle for report in reader.cycles(limit=99)] == [5, 6, 7, 8, 9, 10, 12]


@pytest.mark.process
@pytest.mark.slow
def test_tables_of_a_server_are_read_in_one_snapshot(postgres_url, make_cycle):
    """In batches, with JSON as text, whatever the dispatcher stores meanwhile."""
    with (
        storage.open_database(postgres_url) as database,
        storage.open_reader(postgres_url) as reader,
    ):
        for number in range(1, 4):
            database.record_cycle(*make_cycle(number))
        with reader.tables() as tables:
            batches = tables.rows("plans", batch=4)
            first = next(batches)
            database.record_cycle(*make_cycle(4))
            rows = [*first, *(row for batch in batches for row in batch)]
            assert [row[0] for row in rows] == [1, 1, 2, 2, 3, 3]
            names = [column.name for column in tables.columns("plans")]
            assert json.loads(rows[0][names.index("stops")])[0]["stop"] == "c1"
            cycles = [row[0] for batch in tables.rows("cycles") for row in batch]
            assert cycles == [1, 2, 3]


@pytest.mark.long
@pytest.mark.attack
def test_a_server_that_restarts_costs_cycles(postgres, postgres_url, make_cycle):
    """While it is down nothing is stored and nothing hangs; after it cycles go on, all intact."""
    with (
        storage.open_database(postgres_url, owned=True) as database,
        storage.open_reader(postgres_url) as reader,
    ):
        database.record_cycle(*make_cycle(1))
        assert reader.latest_cycle() == make_cycle(1)[0]
        postgres.stop()
        try:
            for number in (2, 3):
                with pytest.raises(storage.StorageError, match="lock has ended"):
                    database.record_cycle(*make_cycle(number))
                with pytest.raises(storage.StorageError):
                    database.next_cycle_number()
            with pytest.raises(storage.StorageError):
                reader.latest_cycle()
        finally:
            postgres.start()
        assert database.next_cycle_number() == 2
        database.record_cycle(*make_cycle(4))
        assert reader.cycles(limit=9) == (make_cycle(1)[0], make_cycle(4)[0])


@pytest.mark.attack
def test_a_session_cut_in_the_middle_of_a_cycle(postgres, postgres_url, make_cycle):
    """The transaction is rolled back whole; the next cycle is stored with its gates."""
    with storage.open_database(postgres_url, owned=True) as database:
        database.record_cycle(*make_cycle(1))
        engine = database._engine

        @event.listens_for(engine, "before_cursor_execute")
        def _cut(_c, _cursor, statement, *_):
            if statement.startswith("INSERT INTO cycle_traffic"):
                postgres.cut_sessions(postgres_url)

        with pytest.raises(storage.StorageError):
            database.record_cycle(*make_cycle(2))
        event.remove(engine, "before_cursor_execute", _cut)
        assert database.next_cycle_number() == 2
        database.record_cycle(*make_cycle(2))
    with storage.open_reader(postgres_url) as reader:
        assert reader.cycles(limit=9) == (make_cycle(1)[0], make_cycle(2)[0])


@pytest.mark.long
@pytest.mark.attack
def test_a_limit_of_size_is_held_on_a_server(postgres_url, make_cycle, figure):
    """The oldest cycles go until the rest fits, and no more, though files of a server never shrink;
    once deleted rows are cleared away, new cycles take their room.
    """
    keep_mb, added, deleted, largest = 16.0, 80, 0, 0.0
    with storage.open_database(postgres_url, owned=True) as database:
        for number in range(1, added + 1):
            # Random bytes, which the server cannot make smaller: 0.2 MB a cycle.
            made_from = storage.CycleInputs(os.urandom(200_000), {})
            database.record_cycle(*make_cycle(number), made_from=made_from)
            gone = database.trim(keep_mb, limit=5)
            assert not gone or database._pages().count * 8192 > 0.95 * keep_mb * 1e6
            deleted += gone
            if number % 10 == 0:
                with database._engine.connect() as connection:
                    connection.execution_options(isolation_level="AUTOCOMMIT")
                    connection.exec_driver_sql("VACUUM")
                pages = database._pages()
                largest = max(largest, pages.count * 8192 / 1e6)
                assert pages.used * 8192 <= keep_mb * 1e6
        assert [database.trim(keep_mb, limit=5) for _ in range(3)] == [0, 0, 0]
        with storage.open_reader(postgres_url) as reader:
            stored = [report.cycle for report in reader.cycles(limit=999)]
        assert stored == list(range(deleted + 1, added + 1))
        # Some 8 MB are the server's own tables.
        assert 20 <= len(stored) <= 45
        assert largest < 1.4 * keep_mb
        assert database.trim(0.0) == len(stored) - 1
    figure(
        f"keep_mb = {keep_mb:g}: {len(stored)} of {added} cycles, files {largest:.1f} MB at most"
    )


def test_a_password_is_never_shown():
    """What is said of a server that is not there names it without its password."""
    url = "postgresql://slipstream:geheim@127.0.0.1:1/none"
    with pytest.raises((InputError, storage.StorageError)) as caught:
        storage.open_database(url, owned=True)
    assert "127.0.0.1" in str(caught.value)
    assert "geheim" not in str(caught.value)
    assert "\n" not in str(caught.value)
