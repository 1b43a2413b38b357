"""`python -m slipstream_lab.benchmarks.storage`: exit status 0 if all aims are reached."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

from sqlalchemy import create_engine, text

from slipstream_lab.benchmarks.aims import Load, machine
from slipstream_lab.benchmarks.command import Measured, report, say, start
from slipstream_lab.benchmarks.postgres_server import PostgresServer, find_pg_ctl
from slipstream_lab.benchmarks.storage.bench import StorageFigures, checks, measure, write

_DAYS = 30
_SEGMENTS = 1000
# Days pass in minutes: what clears deleted rows away has to keep up.
_FAST_VACUUM = ("autovacuum_naptime=1s", "autovacuum_vacuum_cost_delay=0")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.storage", description=__doc__
    )
    parser.add_argument("--short", action="store_true", help="one day in place of 30")
    parser.add_argument("--days", type=int, help="days of cycles (default: 30)")
    parser.add_argument("--segments", type=int, default=_SEGMENTS, help="watched segments")
    parser.add_argument("--only", choices=("sqlite", "postgresql"), help="one of the databases")
    parser.add_argument("--out", type=Path, default=Path(".slipstream") / "bench-storage")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)
    days = options.days or (1 if options.short else _DAYS)

    def run() -> Measured:
        load = Load()
        figures, missing = [], []
        if options.only != "postgresql":
            figures.append(_sqlite(options.out / "data", days, options.segments))
        if options.only != "sqlite":
            pg_ctl = find_pg_ctl()
            if pg_ctl is None:
                missing.append("no PostgreSQL server is installed")
            else:
                figures.append(_postgresql(pg_ctl, days, options.segments))
        write(options.out, figures, {"machine": machine(), **load.figures()})
        for line in missing:
            say(line)
        return Measured(options.out, [c for f in figures for c in checks(f)], missing)

    return report("bench-storage", run, as_json=options.json)


def _sqlite(folder: Path, days: int, segments: int) -> StorageFigures:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path = folder / "slipstream.db"

    def size() -> int:
        return sum(file.stat().st_size for file in folder.iterdir())

    try:
        return measure("SQLite", f"sqlite:///{path}", size, days, segments, say)
    finally:
        shutil.rmtree(folder)


def _postgresql(pg_ctl: str, days: int, segments: int) -> StorageFigures:
    server = PostgresServer(pg_ctl, *_FAST_VACUUM)
    try:
        url = server.new_database()
        engine = create_engine(url.replace("postgresql", "postgresql+psycopg", 1))

        def size() -> int:
            with engine.connect() as connection:
                query = text("SELECT pg_database_size(current_database())")
                return int(connection.execute(query).scalar_one())

        try:
            return measure("PostgreSQL", url, size, days, segments, say)
        finally:
            engine.dispose()
            server.stop()
    finally:
        server.remove()


if __name__ == "__main__":
    start(main)
