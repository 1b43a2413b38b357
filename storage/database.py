"""The writer: one transaction a cycle, durable when `record_cycle` returns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final, Self

from sqlalchemy import Connection, Engine, delete, func, select
from sqlalchemy.engine import URL
from sqlalchemy.exc import DBAPIError, IntegrityError
from sqlalchemy.orm import Session

from slipstream.errors import InputError
from slipstream.messages import CycleReport, SegmentState, VehiclePlan
from storage import jobs, schema
from storage.engine import (
    StorageError,
    display_name,
    is_sqlite,
    parse_url,
    reader_engine,
    sqlite_path,
    writer_engine,
)
from storage.jobs import QuantumJob
from storage.models import CycleRow
from storage.rows import cycle_row

MALFORMED: Final = "database disk image is malformed"
_MENDS: Final = {
    "file is not a database": "give another file, or move this one away",
    MALFORMED: "restore it from a backup, or move it away",
    "unable to open database file": "check the path and its permissions",
    "attempt to write a readonly database": "make the file and its folder writable",
    "database is locked": "stop the other program that is writing to it",
}
PRUNE_BATCH: Final = 200
"""Cycles deleted in one transaction. A cycle to be recorded waits for at most one of these."""
MIN_JOB_DAYS: Final = 2.0
"""Quantum jobs are kept for at least this long, days: a day's budget is computed from them."""


class Database:
    """The dispatcher's database, open for writing; a context manager."""

    def __init__(self, engine: Engine, source: str) -> None:
        self._engine = engine
        self._source = source

    def record_cycle(
        self,
        report: CycleReport,
        plans: Sequence[VehiclePlan],
        states: Sequence[SegmentState],
    ) -> None:
        """Store a cycle with its plans and the segment states it used, all or nothing.

        Raises:
            ValueError: a plan belongs to another cycle, or the cycle is already stored.
            StorageError: the database cannot be written; nothing of the cycle is stored.
        """
        misplaced = [plan.vehicle for plan in plans if plan.cycle != report.cycle]
        if misplaced:
            raise ValueError(f"plans of another cycle than {report.cycle}: {misplaced}")
        row = cycle_row(report, plans, states)
        try:
            with self._write_session() as session:
                session.add(row)
        except IntegrityError as error:
            raise ValueError(f"cycle {report.cycle} is refused: {error.orig}") from None

    def next_cycle_number(self) -> int:
        """One above the highest cycle stored; 1 in an empty database.

        Raises:
            StorageError: the database cannot be read.
        """
        with self._write_session() as session:
            return (session.scalar(select(func.max(CycleRow.cycle))) or 0) + 1

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

    def prune(self, keep_days: float, now_ns: int, *, limit: int | None = None) -> int:
        """Delete cycles that began more than ``keep_days`` before ``now_ns``.

        The latest cycle always stays, so that cycle numbers never start again. Quantum jobs that
        finished before then are deleted too, but none of the last `MIN_JOB_DAYS`.

        Args:
            keep_days: age limit, days.
            now_ns: UTC.
            limit: maximum number of cycles to delete, oldest first; None: no maximum.

        Returns:
            Number of cycles deleted.

        Raises:
            InputError: ``keep_days`` is negative or not finite.
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
            jobs.prune(session, jobs_before_ns)
        pruned = 0
        while True:
            batch_size = PRUNE_BATCH if limit is None else min(PRUNE_BATCH, limit - pruned)
            with self._write_session() as session:
                latest = session.scalar(select(func.max(CycleRow.cycle)))
                batch = session.scalars(
                    select(CycleRow.cycle)
                    .where(CycleRow.started_ns < before_ns, CycleRow.cycle != latest)
                    .order_by(CycleRow.started_ns)
                    .limit(batch_size)
                ).all()
                session.execute(delete(CycleRow).where(CycleRow.cycle.in_(batch)))
            pruned += len(batch)
            if len(batch) < PRUNE_BATCH or pruned == limit:
                return pruned

    def close(self) -> None:
        """Close all connections; the last one checkpoints the write-ahead log."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _write_session(self) -> Iterator[Session]:
        try:
            with Session(self._engine) as session, session.begin():
                yield session
        except IntegrityError:
            raise
        except DBAPIError as error:
            raise StorageError(f"{self._source}: {error.orig}") from error


def open_database(url: str, *, create: bool = True) -> Database:
    """Open the database for its one writer, and upgrade its schema if it is older.

    Args:
        url: such as ``sqlite:////var/lib/slipstream/slipstream.db``.
        create: create a missing database; if False, a missing one is an error.

    Raises:
        InputError: the URL is invalid, or the database is missing (with ``create`` False), a
            directory, not writable, no database, damaged, another program's, or written by a
            newer version.
    """
    parsed = parse_url(url)
    source = display_name(parsed)
    if is_sqlite(parsed):
        path = sqlite_path(parsed)
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
    engine = writer_engine(parsed)
    try:
        if not is_sqlite(parsed) or sqlite_path(parsed).exists():
            # Read-only first: the writer's pragmas would already change another program's file.
            with _read_connection(parsed) as connection:
                schema.check_ownership(connection, source)
                if not create and schema.current(connection) is None:
                    raise InputError(source, "holds no Slipstream database", "check the path")
        with engine.begin() as connection:
            schema.upgrade(connection)
    except DBAPIError as error:
        engine.dispose()
        raise open_error(source, error) from None
    except UnicodeDecodeError:  # SQLite's own words of a damaged schema
        engine.dispose()
        raise InputError(source, MALFORMED, _MENDS[MALFORMED]) from None
    except BaseException:
        engine.dispose()
        raise
    return Database(engine, source)


@contextmanager
def _read_connection(url: URL) -> Iterator[Connection]:
    engine = reader_engine(url)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


def open_error(source: str, error: DBAPIError) -> InputError:
    """The error for a database that cannot be opened, with its remedy."""
    reason = str(error.orig).strip()
    return InputError(source, reason, _MENDS.get(reason, "check the database"))
