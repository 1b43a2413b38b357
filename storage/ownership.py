"""Ownership of a database: one dispatcher writes its cycles, and notices if the database is gone.

The kernel or the server frees an owner's lock when its process ends, however that happens.
"""

from __future__ import annotations

import errno
import fcntl
import os
import threading
from contextlib import suppress
from pathlib import Path
from typing import Final, TypeAlias

from sqlalchemy import Engine, text
from sqlalchemy.exc import SQLAlchemyError

from slipstream.errors import InputError
from storage.engine import StorageError, is_sqlite, log_path, parse_url, sqlite_path

_ADVISORY_LOCK: Final = 0x51195712EA4
"""Key of the PostgreSQL lock; such locks belong to one database of a server."""
WRITE_LOCK: Final = _ADVISORY_LOCK + 1
"""Key of the lock that a transaction that writes holds for its length."""
_DISK_FAULTS: Final = frozenset((errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EIO))
_MEND: Final = "stop that one, or give this one a database of its own"
_DEAD_AFTER: Final = (
    "tcp_keepalives_idle=3",
    "tcp_keepalives_interval=1",
    "tcp_keepalives_count=3",
)
"""Server's settings, s: the lock of a machine that is gone is free after some 6 s."""


class OwnedError(InputError):
    """Another process owns the database."""


class FileOwner:
    """Owner of an SQLite file, by a lock on a file beside it.

    Args:
        path: the database; a symbolic link is followed, as SQLite does.

    Raises:
        OwnedError: another process owns it.
        InputError: the lock file cannot be made.
        StorageError: its disk is full, read-only or faulty, which may pass.
    """

    def __init__(self, path: Path) -> None:
        place = path.resolve()
        lock = _lock_path(path)
        # Without any of these, commits are lost, or not seen by others. The path itself is watched
        # and not its place: a link may lead elsewhere later.
        self._watched = (
            path,
            log_path(place),
            place.with_name(place.name + "-shm"),
            lock,
        )
        try:
            self._descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
        except OSError as error:
            if error.errno in _DISK_FAULTS:
                line = f"{lock}: {error.strerror}; is the disk full, or its file system read-only?"
                raise StorageError(line) from None
            raise InputError(
                lock, f"cannot be opened: {error.strerror}", "make it and its folder writable"
            ) from None
        try:
            _take(self._descriptor, path)
        except InputError:
            os.close(self._descriptor)
            raise
        with suppress(OSError):  # A full disk: the number is for the other's message only.
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"{os.getpid()}\n".encode(), 0)
        with suppress(OSError):
            if os.geteuid() == 0:
                # As SQLite does for its log: the dispatcher is another user than root.
                status = path.stat()
                os.fchown(self._descriptor, status.st_uid, status.st_gid)
        self._seen = self._identities()

    def watch(self) -> None:
        """Remember the files at the path by device and inode, once the database is open."""
        self._seen = self._identities()

    def lost(self) -> str | None:
        """Why what is committed now would be lost: one of the files was deleted or replaced."""
        for path, seen, present in zip(self._watched, self._seen, self._identities(), strict=True):
            if present != seen:
                return f"{path}: was {'replaced' if present else 'deleted'} while it was open"
        return None

    def set_log_aside(self) -> None:
        """Rename the write-ahead log if the database was replaced and its log was not.

        SQLite would apply the pages in it to the other database and damage that. Close all
        connections first.
        """
        path, log, index, _ = self._watched
        database_seen, log_seen, index_seen, _ = self._seen
        if _identity(path) == database_seen:
            return
        with suppress(OSError):
            if log_seen is not None and _identity(log) == log_seen:
                log.replace(log.with_name(log.name + "-replaced"))
            if index_seen is not None and _identity(index) == index_seen:
                index.unlink()

    def close(self) -> None:
        """Free the lock; its file stays, as another process may be about to lock it."""
        os.close(self._descriptor)

    def _identities(self) -> list[tuple[int, int] | None]:
        return [_identity(path) for path in self._watched]


class ServerOwner:
    """Owner of a PostgreSQL database, by an advisory lock of a connection kept open for it.

    Raises:
        OwnedError: another process owns it.
    """

    def __init__(self, engine: Engine, source: str) -> None:
        self._source = source
        self._lock = threading.Lock()
        self._connection = engine.connect().execution_options(isolation_level="AUTOCOMMIT")
        query = text("SELECT pg_try_advisory_lock(:key)")
        if not self._connection.scalar(query, {"key": _ADVISORY_LOCK}):
            self._connection.close()
            raise OwnedError(source, "is written by another dispatcher", _MEND)
        for setting in _DEAD_AFTER:
            self._connection.execute(text(f"SET {setting}"))

    def watch(self) -> None:
        """Nothing to remember: the connection is the database's."""

    def lost(self) -> str | None:
        """Why the lock is not held any more: its connection has ended."""
        try:
            with self._lock:
                self._connection.scalar(text("SELECT 1"))
        except SQLAlchemyError:
            return f"{self._source}: the connection that held its lock has ended"
        return None

    def set_log_aside(self) -> None:
        """Nothing to do: the server keeps its log."""

    def close(self) -> None:
        """Free the lock."""
        with suppress(SQLAlchemyError):
            # Not back into the pool, where the connection would keep the lock.
            self._connection.invalidate()
            self._connection.close()


Owner: TypeAlias = FileOwner | ServerOwner
"""A held lock on a database."""


def check_free(url: str) -> None:
    """Check that no process owns an SQLite database at present; changes and makes nothing.

    Raises:
        InputError: the URL is invalid, or a process owns it.
    """
    parsed = parse_url(url)
    if not is_sqlite(parsed):
        return
    path = sqlite_path(parsed)
    try:
        descriptor = os.open(_lock_path(path), os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return  # Never owned; or what is wrong is said when it is opened.
    try:
        _take(descriptor, path)
    finally:
        os.close(descriptor)


def _lock_path(path: Path) -> Path:
    place = path.resolve()
    return place.with_name(place.name + "-lock")


def _take(descriptor: int, path: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(descriptor, 20, 0).decode(errors="replace").strip()
        raise OwnedError(
            path, f"is written by another dispatcher (process {holder})", _MEND
        ) from None
    except OSError as error:
        raise InputError(
            _lock_path(path), f"cannot be locked: {error.strerror}", "use a local file system"
        ) from None


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino
