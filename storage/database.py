"""The writer: one transaction a cycle, durable when `record_cycle` returns."""

from __future__ import annotations

import logging
import math
import shutil
import sqlite3
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Final, Self

from sqlalchemy import Engine, func, insert, select
from sqlalchemy.exc import DBAPIError, IntegrityError
from sqlalchemy.orm import Session

from slipstream.errors import InputError
from slipstream.messages import CycleReport, SegmentState, VehiclePlan
from slipstream.orders import FleetRecords, OrderRecord
from storage import fleet, inputs, jobs, retention
from storage.engine import (
    DAMAGED,
    NO_DATABASE,
    StorageError,
    display_name,
    parse_url,
    sqlite_path,
)
from storage.inputs import CycleInputs
from storage.jobs import QuantumJob
from storage.models import CycleRow, StateRow
from storage.opening import open_path
from storage.ownership import FileOwner, Owner
from storage.rows import cycle_row, state_rows

log = logging.getLogger(__name__)

PRUNE_BATCH: Final = 200
"""Maximum number of cycles deleted in one transaction; a cycle to be recorded waits for one."""
MIN_JOB_DAYS: Final = 2.0
"""Quantum jobs are kept for at least this long, days: a day's budget is computed from them."""
MAX_INPUTS: Final = 2000
"""Maximum number of cycles whose inputs one call of `prune` deletes."""
MAX_STEPS: Final = 4
"""Steps of `retention.BATCH_BYTES` in which the running dispatcher's file shrinks after a cycle."""
MAX_CONVERSION_BYTES: Final = 10**9
"""Size up to which a file of a version before is made able to shrink when the dispatcher starts."""


class Database:
    """The dispatcher's database, open for writing; a context manager.

    Args:
        source: its name in messages.
        reopen: opens it; called again where it was deleted or replaced.

    Raises:
        InputError: as `open_database`.
    """

    def __init__(self, source: str, reopen: Callable[[], tuple[Engine, Owner | None]]) -> None:
        self._source = source
        self._reopen = reopen
        self._lock = threading.RLock()
        self._lost: str | None = None
        self._used_pages: int | None = None
        self._engine, self._owner = reopen()
        self._prepare_files()

    def record_cycle(
        self,
        report: CycleReport,
        plans: Sequence[VehiclePlan],
        states: Sequence[SegmentState],
        records: FleetRecords | None = None,
        made_from: CycleInputs | None = None,
    ) -> None:
        """Store a cycle with its plans and the segment states it used, all or nothing.

        Args:
            report: of the cycle.
            plans: of the cycle, as they are published next.
            states: that it used.
            records: what has changed of orders, earlier plans and vehicles.
            made_from: its inputs.

        Raises:
            ValueError: a plan belongs to another cycle, or the cycle is already stored.
            StorageError: the database cannot be written; nothing of the cycle is stored.
        """
        misplaced = [plan.vehicle for plan in plans if plan.cycle != report.cycle]
        if misplaced:
            raise ValueError(f"plans of another cycle than {report.cycle}: {misplaced}")
        row = cycle_row(report, plans)
        try:
            with self._write_session() as session:
                session.add(row)
                session.flush()
                if states:
                    session.execute(insert(StateRow), state_rows(report.cycle, states))
                if records is not None:
                    fleet.save(session, records)
                if made_from is not None:
                    inputs.save(session, report.cycle, made_from)
                retention.note_time(session, report.started_ns)
        except IntegrityError as error:
            raise ValueError(f"cycle {report.cycle} is refused: {error.orig}") from None

    def next_cycle_number(self) -> int:
        """One above the highest cycle stored; 1 in an empty database.

        Where the database was found deleted, replaced or damaged, its path is opened anew first,
        with all checks of `open_database`.

        Raises:
            StorageError: the database cannot be opened or read.
        """
        self._open_anew()
        with self._write_session() as session:
            return (session.scalar(select(func.max(CycleRow.cycle))) or 0) + 1

    def load_fleet(self, now_ns: int) -> FleetRecords:
        """Orders, plans in force and vehicles as they were stored last.

        Raises:
            StorageError: the database cannot be read.
        """
        with self._write_session() as session:
            return fleet.load(session, now_ns)

    def save_fleet(self, records: FleetRecords) -> None:
        """Store what has changed of orders, plans and vehicles beside a cycle.

        Raises:
            StorageError: the database cannot be written.
        """
        with self._write_session() as session:
            fleet.save(session, records)

    def find_orders(self, names: Collection[str]) -> tuple[OrderRecord, ...]:
        """Those of some orders that are stored, however long ago they ended.

        Raises:
            StorageError: the database cannot be read.
        """
        with self._write_session() as session:
            return tuple(fleet.find(session, names))

    def save_job(self, job: QuantumJob) -> None:
        """Store the present record of a quantum job, durably.

        Raises:
            StorageError: the database cannot be written.
        """
        with self._write_session() as session:
            jobs.save(session, job)

    def jobs_since(self, finished_ns: int) -> list[QuantumJob]:
        """Quantum jobs that are open or finished at ``finished_ns`` or later; oldest first.

        Raises:
            StorageError: the database cannot be read.
        """
        with self._write_session() as session:
            return jobs.since(session, finished_ns)

    def trust_clock(self, now_ns: int) -> None:
        """Take ``now_ns``, UTC, for the time, however far ahead of the cycles it is.

        Raises:
            StorageError: the database cannot be written.
        """
        with self._write_session() as session:
            retention.set_time(session, now_ns)

    def prune(
        self,
        keep_days: float,
        now_ns: int,
        *,
        limit: int | None = None,
    ) -> int:
        """Delete cycles that began more than ``keep_days`` before ``now_ns``.

        The latest cycle always stays, so that cycle numbers never start again. Quantum jobs that
        finished before then are deleted too, but none of the last `MIN_JOB_DAYS`; so are orders
        that ended before then and are in no fleet file any more. The inputs of cycles go after
        `inputs.KEEP_DAYS` already.

        Args:
            keep_days: age limit, days.
            now_ns: UTC.
            limit: maximum number of cycles to delete, oldest first; None: no maximum.

        Returns:
            Number of cycles deleted.

        Raises:
            InputError: ``keep_days`` is negative or not finite.
            UntrustedClockError: ``now_ns`` is too far ahead of the cycles; nothing is deleted.
            StorageError: the database cannot be written; batches already deleted stay deleted.
        """
        if not (math.isfinite(keep_days) and keep_days >= 0):
            raise InputError(
                self._source,
                f"cycles cannot be kept for {keep_days} days",
                "give a number of days, 0 or more",
                key="keep_days",
            )
        # No cycle began before 1970, and SQLite takes no number beyond 64 bits.
        before_ns = max(0, now_ns - int(min(keep_days * 86_400e9, 2.0**63)))
        jobs_before_ns = min(before_ns, max(0, now_ns - int(MIN_JOB_DAYS * 86_400e9)))
        with self._write_session() as session:
            retention.check_clock(session, now_ns, self._source)
            jobs.prune(session, jobs_before_ns)
            fleet.prune(session, before_ns)
            below = retention.first_kept(session, before_ns, now_ns)
        self._prune_inputs(max(0, now_ns - int(inputs.KEEP_DAYS * 86_400e9)))
        pruned, batch = 0, self._batch()
        while below is not None and pruned != limit:
            wanted = batch if limit is None else min(batch, limit - pruned)
            with self._write_session() as session:
                count = retention.delete_cycles(session, wanted, below, before_ns)
            pruned += count
            if limit is None:
                self._give_all_back()
            if count < wanted:
                break
        return pruned

    def _prune_inputs(self, before_ns: int) -> None:
        """Delete the inputs of cycles that began before, but at most `MAX_INPUTS` at once."""
        for _ in range(MAX_INPUTS // inputs.BATCH):
            with self._write_session() as session:
                if inputs.prune(session, before_ns) < inputs.BATCH:
                    return

    def trim(self, keep_mb: float, *, limit: int | None = None) -> int:
        """Delete the oldest cycles until an SQLite database fits into ``keep_mb``.

        What counts is the file, a full write-ahead log and the reserve file. The latest cycle
        always stays. The file itself shrinks in a few small steps a call if ``limit`` is given,
        else by `shrink`. A PostgreSQL database is left as it is.

        Args:
            keep_mb: limit of size, MB (10^6 bytes).
            limit: maximum number of cycles to delete; None: no maximum. More are deleted where that
                is less than twice of what was added since the last call.

        Returns:
            Number of cycles deleted.

        Raises:
            InputError: ``keep_mb`` is negative or not finite.
            StorageError: the database cannot be written; batches already deleted stay deleted.
        """
        if not (math.isfinite(keep_mb) and keep_mb >= 0):
            raise InputError(
                self._source,
                f"cycles cannot be kept in {keep_mb} MB",
                "give a number of MB, 0 or more",
                key="keep_mb",
            )
        if not self._is_sqlite:
            return 0
        pages = began = self._pages()
        grown = 0 if self._used_pages is None else began.used - self._used_pages
        wanted = int(began.limit(keep_mb) * (1 - retention.FREE_SHARE))
        trimmed, batch = 0, 0
        while pages.used > wanted:
            if limit is not None and trimmed >= limit and began.used - pages.used >= 2 * grown:
                break
            batch = batch or min(self._batch(), limit or PRUNE_BATCH)
            with self._write_session() as session:
                latest = session.scalar(select(func.max(CycleRow.cycle))) or 0
                count = retention.delete_cycles(session, batch, latest)
            if count == 0:
                break
            trimmed += count
            if limit is None:
                self._give_all_back()
            pages = self._pages()
        self._used_pages = pages.used
        if limit is not None:
            for _ in range(MAX_STEPS):
                if pages.free <= 2 * retention.FREE_SHARE * pages.count or not self._give_back():
                    break
                pages = self._pages()
        return trimmed

    def shrink(self) -> str | None:
        """Give the free pages of an SQLite file back to the file system.

        A file of a version before is made able to do so first, which takes a lock on it for its
        length and room for twice its contents.

        Returns:
            Why the file could not shrink; None if it has.

        Raises:
            StorageError: the database cannot be written.
        """
        if not self._is_sqlite:
            return None
        with self._raw() as cursor:
            incremental = cursor.execute("PRAGMA auto_vacuum").fetchone()[0]
        if not incremental:
            return self._convert()
        self._give_all_back()
        return None

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

    def _prepare_files(self) -> None:
        """Make an owner's reserve file, and a small file of a version before able to shrink."""
        if self._owner is None or not self._is_sqlite:
            return
        path = sqlite_path(self._engine.url)
        if not retention.make_reserve(path):
            log.warning("%s: no room for its reserve file", self._source)
        with self._raw() as cursor:
            incremental = cursor.execute("PRAGMA auto_vacuum").fetchone()[0]
        if incremental:
            return
        problem: str | None = "the file is too large to be rewritten at a start"
        if path.stat().st_size <= MAX_CONVERSION_BYTES:
            try:
                problem = self._convert()
            except StorageError as error:
                problem = str(error)
        if problem is not None:
            log.warning("%s: %s; see `slipstream db prune` in operations.md", self._source, problem)

    @contextmanager
    def _write_session(self) -> Iterator[Session]:
        with self._lock:
            self._check_place()
            try:
                with Session(self._engine) as session, session.begin():
                    yield session
                    session.flush()
                    self._check_place()
            except IntegrityError:
                raise
            except DBAPIError as error:
                raise self._fault(error.orig) from error
            # Once more: what was committed to a file that was deleted meanwhile is lost.
            self._check_place()

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
        with self._lock:
            if self._lost is None:
                return
            self._engine.dispose()
            if self._owner is not None:
                self._owner.set_log_aside()
            self.close()
            try:
                self._engine, self._owner = self._reopen()
            except InputError as error:
                raise StorageError(str(error)) from None
            log.warning("%s; it was opened anew", self._lost)
            self._lost = self._used_pages = None
            self._prepare_files()

    @contextmanager
    def _raw(self) -> Iterator[sqlite3.Cursor]:
        """A cursor outside of transactions, for statements that cannot be in one."""
        with self._lock:
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

    def _pages(self) -> retention.Pages:
        with self._raw() as cursor:
            return retention.read_pages(cursor)

    def _batch(self) -> int:
        """Number of cycles to delete in one transaction."""
        if not self._is_sqlite:
            return PRUNE_BATCH
        pages = self._pages()
        with self._write_session() as session:
            cycles = session.scalar(select(func.count()).select_from(CycleRow)) or 0
        mean_bytes = pages.used * pages.size / max(1, cycles)
        return max(1, min(PRUNE_BATCH, int(retention.BATCH_BYTES / mean_bytes)))

    def _give_back(self) -> bool:
        """Give one step of free pages back to the file system; False if there was none."""
        pages = self._pages()
        with self._raw() as cursor:
            number = retention.BATCH_BYTES // pages.size
            # `execute` would do its first step only, which is one page.
            cursor.executescript(f"PRAGMA incremental_vacuum({number})")
        return self._pages().free < pages.free

    def _give_all_back(self) -> None:
        """Give all free pages back, with room for one step in the log."""
        if self._is_sqlite:
            self._empty_log()
            while self._give_back():
                self._empty_log()

    def _empty_log(self) -> None:
        """Copy the write-ahead log into the file and truncate it, if no reader is in the way."""
        with self._raw() as cursor:
            cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def _convert(self) -> str | None:
        """Rewrite a file of a version before so that it can shrink; see `shrink`."""
        path = sqlite_path(self._engine.url)
        pages = self._pages()
        needed = 2.2 * pages.used * pages.size
        if shutil.disk_usage(path.parent).free < needed:
            return f"the file cannot shrink: that needs {needed / 1e6:.0f} MB of free disk once"
        with ExitStack() as stack:
            if self._owner is None:
                try:
                    stack.callback(FileOwner(path).close)
                except InputError as error:
                    return f"the file cannot shrink: {error.problem}; stop it and prune again"
            with self._raw() as cursor:
                cursor.execute("VACUUM")
            self._empty_log()
        return None


def open_database(url: str, *, create: bool = True, owned: bool = False) -> Database:
    """Open the database for writing, and upgrade its schema if it is older.

    Args:
        url: such as ``sqlite:////var/lib/slipstream/slipstream.db``.
        create: create a missing database; if False, a missing one is an error.
        owned: for the one dispatcher that writes its cycles: no other process may own it, and a
            commit to a file that was deleted or replaced is an error.

    Raises:
        InputError: the URL is invalid, or the database is missing (with ``create`` False), a
            directory, not writable, no database, damaged, another program's, written by a
            newer version, or owned by another process (with ``owned`` True).
        StorageError: there is no room, or the disk has a fault.
    """
    parsed = parse_url(url)
    return Database(display_name(parsed), lambda: open_path(parsed, create=create, owned=owned))
