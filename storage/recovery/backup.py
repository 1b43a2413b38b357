"""Backup of a database that is being written, and its restore."""

from __future__ import annotations

import time
from pathlib import Path

from sqlalchemy import func, insert, inspect, select
from sqlalchemy.engine import URL

from slipstream.errors import InputError
from slipstream.messages import CycleReport
from storage.engine import display_name, is_sqlite, parse_url, sqlite_path, writer_engine
from storage.integrity import CheckReport, check
from storage.models import CycleRow
from storage.opening import damaged
from storage.ownership import FileOwner
from storage.recovery import files
from storage.rows import cycle_row

NUMBERS_LEFT_OUT = 1000
"""Numbers of cycles that are not given again where the last ones cannot be read."""


def backup(url: str, target: Path) -> CheckReport:
    """Copy an SQLite database to a new file and check the copy; a dispatcher may write meanwhile.

    Returns:
        What the check of the copy found.

    Raises:
        InputError: the database is missing, damaged or another program's, or the file is there
            already; for PostgreSQL, with the command of its own.
        StorageError: it cannot be read, or there is no room.
    """
    parsed = parse_url(url)
    if not is_sqlite(parsed):
        raise InputError(
            display_name(parsed),
            "is no SQLite file",
            f"use the server's program: pg_dump --format=custom --file={target} {_libpq(parsed)}",
        )
    place = sqlite_path(parsed)
    _check_present(place)
    if target.exists():
        raise InputError(target, "is there already", "give another name")
    if not target.parent.is_dir():
        raise InputError(target.parent, "no such folder", "make it, or give another name")
    with files.new_file(target) as part:
        files.copy(place, part)
        files.check_sound(part, place)
        report = check(f"sqlite:///{part}")
        if report.schema_version is None:
            raise InputError(place, "holds no Slipstream database", "check the path")
        if target.exists():
            raise InputError(target, "is there already", "give another name")
        part.replace(target)
    return report


def restore(url: str, source: Path) -> Path | None:
    """Put a backup in place of an SQLite database, which is kept under another name.

    Cycles go on above the numbers of both, as vehicles refuse plans of lower ones.

    Returns:
        Where the former database is; None if there was none.

    Raises:
        InputError: a dispatcher writes the database, or the backup is missing, damaged, another
            program's, or of a newer version; for PostgreSQL, with the command of its own.
        StorageError: it cannot be read, or there is no room.
    """
    parsed = parse_url(url)
    if not is_sqlite(parsed):
        raise InputError(
            display_name(parsed),
            "is no SQLite file",
            f"use the server's program: pg_restore --clean --if-exists --dbname={_libpq(parsed)} "
            f"{source}",
        )
    path = sqlite_path(parsed)
    _check_present(source)
    if path.exists() and path.samefile(source):
        raise InputError(source, "is the database itself", "give a backup")
    if not path.parent.is_dir():
        raise InputError(path.parent, "no such folder", "make it, or give another URL")
    report = check(f"sqlite:///{source}")
    if report.faults:
        raise damaged(str(source), report.faults[0])
    if report.schema_version is None:
        raise InputError(source, "holds no Slipstream database", "check the path")
    owner = FileOwner(path)
    try:
        place = path.resolve()
        highest = files.highest_cycle(place) if place.exists() else None
        with files.new_file(place) as part:
            files.copy(source, part)
            _go_on_above(part, highest, f"restored from the backup {source.name}")
            return files.replace(place, part, "before-restore")
    finally:
        owner.close()


def _go_on_above(part: Path, highest: int | None, reason: str) -> None:
    """Have a database's cycles go on above a number, by a cycle that says why. Its schema stays, so
    that the release that it is of can take it, too.
    """
    if highest is None:
        return
    row = cycle_row(empty_report(highest + 1, time.time_ns(), reason), [])
    engine = writer_engine(parse_url(f"sqlite:///{part}"))
    try:
        with engine.begin() as connection:
            last = connection.scalar(select(func.max(CycleRow.cycle)))
            if highest > (last or 0):
                columns = inspect(connection).get_columns(CycleRow.__tablename__)
                there = {column["name"] for column in columns} & {*CycleRow.__table__.c.keys()}
                values = {name: getattr(row, name) for name in there}
                connection.execute(insert(CycleRow).values(values))
    finally:
        engine.dispose()


def empty_report(cycle: int, started_ns: int, reason: str, plans: int = 0) -> CycleReport:
    """The report of a cycle that was not one of the dispatcher's."""
    return CycleReport(
        cycle=cycle,
        started_ns=started_ns,
        wall_s=0.0,
        status="failed",
        reason=reason,
        solver=None,
        objective_kwh=None,
        variables=0,
        solvers=(),
        gates=(),
        energy=None,
        plans=plans,
    )


def _check_present(path: Path) -> None:
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "no such file"
        raise InputError(path, what, "check the path")


def _libpq(url: URL) -> str:
    """The URL as the server's programs take it, without its password."""
    plain = URL.create("postgresql", url.username, None, url.host, url.port, url.database)
    return plain.render_as_string()
