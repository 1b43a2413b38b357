"""What the dispatcher needs of a PostgreSQL server, where one can be started."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

import storage
from slipstream.errors import InputError

DAY_NS = 86_400_000_000_000


@pytest.fixture
def server() -> Iterator[str]:
    """URL of a database on a server of its own."""
    pytest.importorskip("psycopg")
    programs = sorted(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"))
    if not programs:
        pytest.skip("no PostgreSQL server is installed")
    # It refuses to run as root, and its socket needs a short path.
    user = "postgres" if os.geteuid() == 0 else None
    folder = Path(tempfile.mkdtemp(prefix="slipstream-pg-"))
    if user is not None:
        shutil.chown(folder, user)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1"

    def control(*arguments: str) -> None:
        command = [str(programs[-1]), "-D", str(folder / "data"), *arguments]
        subprocess.run(command, user=user, check=True, stdout=subprocess.DEVNULL, cwd=folder)

    try:
        control("-o", "-A trust -U postgres", "initdb")
        control("-o", options, "-l", str(folder / "log"), "-w", "start")
        yield f"postgresql+psycopg://postgres@127.0.0.1:{port}/postgres"
        control("-m", "immediate", "-w", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.attack
@pytest.mark.process
@pytest.mark.slow
def test_one_dispatcher_owns_a_database_of_a_server(server, make_cycle):
    """A second one is refused; a lost lock costs cycles until the next opening; ages are kept."""
    with storage.open_database(server, owned=True) as database:
        for number in range(1, 11):
            database.record_cycle(*make_cycle(number))
        with pytest.raises(InputError, match="another dispatcher"):
            storage.open_database(server, owned=True)
        with storage.headroom(server), storage.open_database(server, create=False) as command:
            assert command.prune(0.0, make_cycle(5)[0].started_ns) == 4
            assert (command.trim(0.0), command.shrink()) == (0, None)
        with pytest.raises(storage.UntrustedClockError):
            database.prune(90.0, make_cycle(10)[0].started_ns + 400 * DAY_NS)
        engine = create_engine(server, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.execute(
                text(
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                    "WHERE pid <> pg_backend_pid() AND datname = 'postgres'"
                )
            )
        engine.dispose()
        with pytest.raises(storage.StorageError, match="connection that held its lock"):
            database.record_cycle(*make_cycle(11))
        assert database.next_cycle_number() == 11
        database.record_cycle(*make_cycle(12))
        with pytest.raises(InputError, match="another dispatcher"):
            storage.open_database(server, owned=True)
    storage.open_database(server, owned=True).close()
    with storage.open_reader(server) as reader:
        assert [report.cycle for report in reader.cycles(limit=99)] == [5, 6, 7, 8, 9, 10, 12]


@pytest.mark.process
@pytest.mark.slow
def test_tables_of_a_server_are_read_in_one_snapshot(server, make_cycle):
    """In batches, with JSON as text, whatever the dispatcher stores meanwhile."""
    with storage.open_database(server) as database, storage.open_reader(server) as reader:
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
