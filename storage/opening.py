"""Opens a database for writing, after its checks; what cannot be opened is one line."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

from sqlalchemy import Connection, Engine
from sqlalchemy.engine import URL
from sqlalchemy.exc import DBAPIError, OperationalError

from slipstream.errors import InputError
from storage import schema
from storage.engine import (
    DAMAGED,
    NO_DATABASE,
    StorageError,
    display_name,
    is_sqlite,
    reader_engine,
    sqlite_faults,
    sqlite_path,
    writer_engine,
)
from storage.ownership import FileOwner, Owner, ServerOwner

_RESTORE: Final = "restore it from a backup, or move it away"
_MISTAKES: Final = ("authentication failed", "does not exist", "no pg_hba.conf entry")
"""What a PostgreSQL server says of a wrong URL; its other refusals may be temporary."""


def open_path(url: URL, *, create: bool, owned: bool) -> tuple[Engine, Owner | None]:
    """Open what is at the path of a URL now; see `storage.database.open_database`.

    Raises:
        InputError: it cannot be used.
        StorageError: there is no room, or the disk has a fault.
    """
    source = display_name(url)
    if is_sqlite(url):
        path = sqlite_path(url)
        if path.is_dir():
            raise InputError(source, "is a directory", "give a file in it")
        if path.exists() and not path.is_file():  # SQLite would wait for a pipe's writer
            raise InputError(source, "a pipe, device or socket, no file", "give a file")
        if not create and not path.exists():
            raise InputError(source, "no such file", "check the path")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                path.parent, f"cannot make this folder: {error.strerror}", "choose another place"
            ) from None
    with ExitStack() as stack:
        engine = writer_engine(url)
        stack.callback(engine.dispose)
        owner: Owner | None = None
        try:
            if owned:
                owner = FileOwner(path) if is_sqlite(url) else ServerOwner(engine, source)
                stack.callback(owner.close)
            if not is_sqlite(url) or sqlite_path(url).exists():
                # Read-only first: the writer's pragmas would already change another program's file.
                with _read_connection(url) as connection:
                    schema.check_ownership(connection, source)
                    if not create and schema.current(connection) is None:
                        raise InputError(source, "holds no Slipstream database", "check the path")
                    if is_sqlite(url) and (faults := sqlite_faults(connection)):
                        raise damaged(source, faults[0])
            with engine.begin() as connection:
                if schema.current(connection) != schema.HEAD:
                    schema.upgrade(connection)
        except DBAPIError as error:
            raise open_error(source, error) from None
        if owner is not None:
            owner.watch()
        stack.pop_all()
    return engine, owner


@contextmanager
def _read_connection(url: URL) -> Iterator[Connection]:
    engine = reader_engine(url)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


class DamagedError(InputError):
    """The file of a database is damaged."""


def damaged(source: str, fault: str) -> DamagedError:
    """The error for a database with faults, with its remedy."""
    return DamagedError(source, f"is damaged: {fault}", _RESTORE)


def open_error(source: str, error: DBAPIError) -> InputError | StorageError:
    """The error for a database that cannot be opened, with its remedy if there is one."""
    reason = str(error.orig).strip()
    if reason in ("database or disk is full", "disk I/O error"):
        # SQLite has the second one for its log's index on a full disk.
        return StorageError(f"{source}: {reason}; is there room on the disk?")
    if isinstance(error, OperationalError) and not isinstance(error.orig, sqlite3.Error):
        if any(mistake in reason for mistake in _MISTAKES):
            return InputError(source, " ".join(reason.split()), "check the URL and the server")
        return StorageError(f"{source}: {reason}")
    if reason in (NO_DATABASE, DAMAGED):
        mend = "give another file, or move this one away"
        return DamagedError(source, reason, mend if reason == NO_DATABASE else _RESTORE)
    mend = {
        "unable to open database file": "check the path and its permissions",
        "attempt to write a readonly database": "make the file and its folder writable",
        "database is locked": "stop the other program that is writing to it",
    }.get(reason, "check the database")
    return InputError(source, reason, mend)
