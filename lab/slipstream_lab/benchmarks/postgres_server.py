"""A PostgreSQL server that tests and benchmarks start."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from sqlalchemy import create_engine, text

from slipstream.bus import free_port


def find_pg_ctl() -> str | None:
    """The program that starts a server; Debian keeps it out of the path."""
    found = sorted(str(path) for path in Path("/usr/lib/postgresql").glob("*/bin/pg_ctl"))
    return found[-1] if found else shutil.which("pg_ctl")


class PostgresServer:
    """A PostgreSQL server of its own on a free port of the loopback interface.

    Args:
        pg_ctl: the program that starts it; see `find_pg_ctl`.
        settings: of the server; by default it need not survive the machine.
    """

    def __init__(self, pg_ctl: str, *settings: str) -> None:
        self._pg_ctl = pg_ctl
        self._settings = settings or ("fsync=off",)
        # It refuses to run as root, and its socket needs a short path.
        self._user = "postgres" if os.geteuid() == 0 else None
        self._folder = Path(tempfile.mkdtemp(prefix="slipstream-pg-"))
        if self._user is not None:
            shutil.chown(self._folder, self._user)
        self._port = free_port()
        self._made = 0
        self._control("-o", "-A trust -U postgres --no-sync", "initdb")
        self.start()

    def start(self) -> None:
        """Start it, and wait until it answers."""
        settings = " ".join(f"-c {s}" for s in ("listen_addresses=127.0.0.1", *self._settings))
        options = f"-p {self._port} -k {self._folder} {settings}"
        self._control("-o", options, "-l", str(self._folder / "log"), "-w", "start")

    def stop(self) -> None:
        """Stop it at once, as a crash does."""
        self._control("-m", "immediate", "-w", "stop")

    def remove(self) -> None:
        """Delete its files."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def new_database(self) -> str:
        """URL of an empty database."""
        self._made += 1
        name = f"test_{self._made}"
        self.execute(f"CREATE DATABASE {name}")
        return self._url(name)

    def execute(self, statement: str) -> None:
        """Execute a statement as the server's administrator."""
        engine = create_engine(
            self._url("postgres").replace("postgresql", "postgresql+psycopg", 1),
            isolation_level="AUTOCOMMIT",
        )
        with engine.connect() as connection:
            connection.execute(text(statement))
        engine.dispose()

    def cut_sessions(self, url: str) -> None:
        """End all connections to a database."""
        name = url.rpartition("/")[2]
        self.execute(
            f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'"
        )

    def _url(self, database: str) -> str:
        return f"postgresql://postgres@127.0.0.1:{self._port}/{database}"

    def _control(self, *arguments: str) -> None:
        command = [self._pg_ctl, "-D", str(self._folder / "data"), *arguments]
        subprocess.run(
            command, user=self._user, check=True, stdout=subprocess.DEVNULL, cwd=self._folder
        )
