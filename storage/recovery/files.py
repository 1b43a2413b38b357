"""SQLite files: copied while they are written, put in place of another one, never lost."""

from __future__ import annotations

import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Final

from sqlalchemy.exc import DBAPIError

from storage.engine import (
    StorageError,
    parse_url,
    read_only_address,
    reader_engine,
    sqlite_faults,
)
from storage.opening import damaged, open_error

_PAGES_A_STEP: Final = 1024
_TABLES: Final = ("cycles", "plans", "solver_runs")
"""Tables with a column of the cycle's number."""
_LOGS: Final = ("-wal", "-shm")


def copy(source: Path, target: Path) -> None:
    """Copy a database to a new file, as it is at one moment; writers are not held up.

    Raises:
        StorageError: it cannot be read, or there is no room.
    """
    address = read_only_address(source)
    try:
        with (
            closing(sqlite3.connect(address, uri=True, isolation_level=None)) as read,
            closing(sqlite3.connect(target, isolation_level=None)) as written,
        ):
            # Held for the whole copy, which would begin anew with each cycle that is stored.
            read.execute("BEGIN")
            read.execute("SELECT 1 FROM sqlite_master").fetchall()
            read.backup(written, pages=_PAGES_A_STEP)
            # One file, that may be moved alone.
            written.execute("PRAGMA journal_mode=DELETE").fetchall()
    except sqlite3.Error as error:
        raise StorageError(f"{source}: cannot be copied: {error}") from None
    with target.open("rb") as file:
        os.fsync(file.fileno())


def check_sound(path: Path, source: Path) -> None:
    """Check the integrity of a copy.

    Raises:
        DamagedError: it is damaged, and so is ``source``, which it is of.
        StorageError: it cannot be read.
    """
    engine = reader_engine(parse_url(f"sqlite:///{path}"))
    try:
        with engine.begin() as connection:
            faults = sqlite_faults(connection)
    except DBAPIError as error:
        raise open_error(str(source), error) from None
    finally:
        engine.dispose()
    if faults:
        raise damaged(str(source), faults[0])


@contextmanager
def new_file(place: Path) -> Iterator[Path]:
    """A name for a file beside a place, which is deleted at the end if it is still there.

    It gets the rights and the owner of the file at the place, or of its folder.

    Raises:
        StorageError: no file can be made there.
    """
    try:
        descriptor, name = tempfile.mkstemp(dir=place.parent, prefix=f"{place.name}-")
    except OSError as error:
        raise StorageError(f"{place.parent}: cannot write here: {error.strerror}") from None
    path = Path(name)
    try:
        status = place.stat() if place.exists() else place.parent.stat()
        os.fchmod(descriptor, status.st_mode & 0o660 if place.exists() else 0o640)
        with suppress(OSError):
            if os.geteuid() == 0:
                os.fchown(descriptor, status.st_uid, status.st_gid)
        os.close(descriptor)
        yield path
    finally:
        for leftover in (path, *(path.with_name(path.name + end) for end in (*_LOGS, "-journal"))):
            leftover.unlink(missing_ok=True)


def replace(place: Path, new: Path, kind: str) -> Path | None:
    """Put a new file in a place, and keep the one that was there under another name.

    Close all connections first, and own the database. At every moment there is a file.

    Args:
        place: of the database, no link.
        new: a complete database without a log.
        kind: of the former one's name: ``{name}-{kind}-{UTC}``.

    Returns:
        Where the former file is; None if there was none.
    """
    aside = _free_name(place, kind) if place.exists() else None
    if aside is not None:
        # A log that stays would be applied to the new file and damage it.
        for end in _LOGS:
            log = place.with_name(place.name + end)
            if log.exists():
                log.rename(aside.with_name(aside.name + end))
        os.link(place, aside)
    new.replace(place)
    folder = os.open(place.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return aside


def _free_name(place: Path, kind: str) -> Path:
    first = place.with_name(f"{place.name}-{kind}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}")
    names = (first.with_name(f"{first.name}-{number}") for number in count(2))
    return next(name for name in chain([first], names) if not name.exists())


def highest_cycle(path: Path) -> int | None:
    """The highest number of a cycle that can still be read in a file; None if none can."""
    numbers: list[int] = []
    address = read_only_address(path)
    for table in _TABLES:
        with (
            suppress(sqlite3.Error, UnicodeDecodeError, OverflowError),
            closing(sqlite3.connect(address, uri=True)) as connection,
        ):
            number = connection.execute(f"SELECT max(cycle) FROM {table}").fetchone()[0]
            if isinstance(number, int):
                numbers.append(number)
    return max(numbers, default=None)
