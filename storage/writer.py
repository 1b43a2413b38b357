"""What stands behind the writer: its connections, its place on the disk, the size of its file."""

from __future__ import annotations

import logging
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Final, Self

from sqlalchemy import Engine, func, select, text
from sqlalchemy.exc import DBAPIError, IntegrityError
from sqlalchemy.orm import Session

from slipstream.errors import InputError
from storage import retention
from storage.engine import DAMAGED, NO_DATABASE, StorageError, sqlite_path
from storage.models import CycleRow
from storage.ownership import WRITE_LOCK, OwnedError, Owner

log = logging.getLogger(__name__)

WRITE_WITHIN_S: Final = 30.0
"""What any other writer waits for its turn, s: longer than a step of those before it takes."""


class Writer:
    """The connections of the one writer; a context manager.

    Args:
        reopen: opens it; called again where it was deleted or replaced.

    Raises:
        InputError: as `storage.database.open_database`.
    """

    def __init__(self, source: str, reopen: Callable[[], tuple[Engine, Owner | None]]) -> None:
        self._source = source
        self._reopen = reopen
        self._lock = threading.RLock()
        self._lost: str | None = None
        self._engine, self._owner = reopen()
        self._make_reserve()

    def close(self) -> None:
        """Close all connections; the last one checkpoints the write-ahead log."""
        with self._lock:
            self._engine.dispose()
            if self._owner is not None:
                self._owner.close()
                self._owner = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _is_sqlite(self) -> bool:
        return self._engine.dialect.name == "sqlite"

    def _make_reserve(self) -> None:
        """Make an owner's reserve file."""
        if self._owner is None or not self._is_sqlite:
            return
        if not retention.make_reserve(sqlite_path(self._engine.url)):
            log.warning("%s: no room for its reserve file", self._source)

    @contextmanager
    def _write_session(self, within_s: float = WRITE_WITHIN_S) -> Iterator[Session]:
        """A transaction; one that has no turn in time raises `StorageError`."""
        with self._turn(within_s):
            self._check_place()
            try:
                with Session(self._engine) as session, session.begin():
                    if not self._is_sqlite:
                        # As SQLite's transactions do: commands write beside the dispatcher.
                        timeout = text(f"SET LOCAL lock_timeout = {round(1000 * within_s)}")
                        session.execute(timeout)
                        session.execute(select(func.pg_advisory_xact_lock(WRITE_LOCK)))
                    yield session
                    session.flush()
                    self._check_place()
            except IntegrityError:
                raise
            except DBAPIError as error:
                raise self._fault(error.orig) from error
            # Once more: what was committed to a file that was deleted meanwhile is lost.
            self._check_place()

    @contextmanager
    def _turn(self, within_s: float) -> Iterator[None]:
        if not self._lock.acquire(timeout=within_s):
            raise StorageError(f"{self._source}: busy for {within_s:g} s")
        try:
            yield
        finally:
            self._lock.release()

    def _check_place(self) -> None:
        """Check that commits go to where others read them."""
        if self._lost is None and self._owner is not None:
            self._lost = self._owner.lost()
        if self._lost is not None:
            raise StorageError(self._lost)

    def _fault(self, error: BaseException | None) -> StorageError:
        """The error for a fault of the driver's; a damaged file has to be opened anew."""
        line = f"{self._source}: {error}"
        if self._owner is not None and str(error) in (DAMAGED, NO_DATABASE):
            self._lost = line
        return StorageError(line)

    def _open_anew(self) -> None:
        with self._turn(WRITE_WITHIN_S):
            if self._lost is None and self._owner is not None:
                self._lost = self._owner.lost()
            if self._lost is None:
                return
            self._engine.dispose()
            if self._owner is not None:
                self._owner.set_log_aside()
            self.close()
            try:
                self._engine, self._owner = self._reopen()
            except OwnedError:
                # What this process knows is older than what that one has stored since.
                raise
            except InputError as error:
                raise StorageError(str(error)) from None
            log.warning("%s; it was opened anew", self._lost)
            self._lost = None
            self._forget()
            self._make_reserve()

    def _forget(self) -> None:
        """Forget what was known of the database that is replaced."""

    @contextmanager
    def _raw(self) -> Iterator[sqlite3.Cursor]:
        """A cursor outside of transactions, for statements that cannot be in one."""
        with self._turn(WRITE_WITHIN_S):
            self._check_place()
            try:
                with (
                    closing(self._engine.raw_connection()) as connection,
                    closing(connection.cursor()) as cursor,
                ):
                    yield cursor  # type: ignore[misc]
            except DBAPIError as error:
                raise self._fault(error.orig) from error
            except sqlite3.Error as error:
                raise self._fault(error) from error
            except UnicodeDecodeError as error:
                raise self._fault(sqlite3.DatabaseError(DAMAGED)) from error

    def _pages(self, keep_mb: float = 0.0) -> retention.Pages:
        if self._is_sqlite:
            with self._raw() as cursor:
                return retention.read_pages(cursor)
        try:
            # Without the lock that writers take turns by: the estimate takes some 20 ms.
            with Session(self._engine) as session:
                return retention.read_server_pages(session, keep_mb)
        except DBAPIError as error:
            raise self._fault(error.orig) from error

    def _batch(self, pages: retention.Pages | None) -> int:
        """Number of cycles to delete in one transaction, at most; None: whatever they take."""
        if pages is None:
            return retention.PRUNE_BATCH
        with self._write_session() as session:
            cycles = session.scalar(select(func.count()).select_from(CycleRow)) or 0
        mean_bytes = pages.used * pages.size / max(1, cycles)
        return max(1, min(retention.PRUNE_BATCH, int(retention.BATCH_BYTES / mean_bytes)))

    def _give_back(self) -> bool:
        """Give one step of free pages back to the file system; False if there was none."""
        pages = self._pages()
        with self._raw() as cursor:
            number = retention.BATCH_BYTES // pages.size
            # `execute` would do its first step only, which is one page.
            cursor.executescript(f"PRAGMA incremental_vacuum({number})")
        return self._pages().free < pages.free

    def shrink(self) -> None:
        """Give the free pages of an SQLite file back to the file system, with room for one step in
        the log.
        """
        if self._is_sqlite:
            self._empty_log()
            while self._give_back():
                self._empty_log()

    def _empty_log(self) -> None:
        """Copy the write-ahead log into the file and truncate it, if no reader is in the way."""
        with self._raw() as cursor:
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
