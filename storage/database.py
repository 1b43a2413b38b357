"""The writer's side: one transaction a cycle, durable when `record_cycle` returns."""

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
    is_sqlite,
    parse_url,
    reader_engine,
    shown,
    sqlite_path,
    writer_engine,
)
from storage.jobs import QuantumJob
from storage.models import CycleRow
from storage.rows import cycle_row

PRUNE_BATCH: Final = 200
"""Cycles deleted in one transaction: short enough that a cycle to be recorded hardly waits."""
LEAST_JOB_DAYS: Final = 2.0
"""Quantum jobs are kept at least so long: the budget of a day is computed from them."""


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
        """Store a cycle with its plans and the states that it was decided on, all or nothing.

        Raises:
            ValueError: a plan belongs to another cycle, or the cycle is already stored.
            StorageError: the database cannot be written; nothing of the cycle is stored.
        """
        strangers = [plan.vehicle for plan in plans if plan.cycle != report.cycle]
        if strangers:
            raise ValueError(f"plans of another cycle than {report.cycle}: {strangers}")
        row = cycle_row(report, plans, states)
        try:
            with self._writing() as session:
                session.add(row)
        except IntegrityError as error:
            raise ValueError(f"cycle {report.cycle} is refused: {error.orig}") from None

    def next_cycle_number(self) -> int:
        """One above the highest cycle stored; 1 in an empty database.

        Raises:
            StorageError: the database cannot be read.
        """
        with self._writing() as session:
            return (session.scalar(select(func.max(CycleRow.cycle))) or 0) + 1

    def save_job(self, job: QuantumJob) -> None:
        """Store what is known of a quantum job, durably.

        Raises:
            StorageError: the database cannot be written.
        """
        with self._writing() as session:
            jobs.save(session, job)

    def jobs_since(self, finished_ns: int) -> list[QuantumJob]:
        """Quantum jobs that are open or were found to be over since; oldest first.

        Raises:
            StorageError: the database cannot be read.
        """
        with self._writing() as session:
            return jobs.since(session, finished_ns)

    def prune(self, keep_days: float, now_ns: int, *, limit: int | None = None) -> int:
        """Delete cycles that began more than ``keep_days`` before ``now_ns``.

        The latest cycle always stays, so that cycle numbers never start again. Quantum jobs that
        were over by then go too, but none of the last `LEAST_JOB_DAYS`.

        Args:
            keep_days: age limit, days.
            now_ns: UTC.
            limit: delete no more cycles than this, the oldest ones; None: all that are too old.

        Returns:
            How many cycles were deleted.

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
        jobs_before_ns = min(before_ns, max(0, now_ns - int(LEAST_JOB_DAYS * 86_400e9)))
        with self._writing() as session:
            jobs.prune(session, jobs_before_ns)
        pruned = 0
        while True:
            most = PRUNE_BATCH if limit is None else min(PRUNE_BATCH, limit - pruned)
            with self._writing() as session:
                latest = session.scalar(select(func.max(CycleRow.cycle)))
                batch = session.scalars(
                    select(CycleRow.cycle)
                    .where(CycleRow.started_ns < before_ns, CycleRow.cycle != latest)
                    .order_by(CycleRow.started_ns)
                    .limit(most)
                ).all()
                session.execute(delete(CycleRow).where(CycleRow.cycle.in_(batch)))
            pruned += len(batch)
            if len(batch) < PRUNE_BATCH or pruned == limit:
                return pruned

    def close(self) -> None:
        """Close all connections; the last one folds the log back into the file."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _writing(self) -> Iterator[Session]:
        try:
            with Session(self._engine) as session, session.begin():
                yield session
        except IntegrityError:
            raise
        except DBAPIError as error:
            raise StorageError(f"{self._source}: {error.orig}") from error


def open_database(url: str, *, create: bool = True) -> Database:
    """Open the database for its one writer; bring its schema up where needed.

    Args:
        url: such as ``sqlite:////var/lib/slipstream/slipstream.db``.
        create: make the database where there is none; otherwise it is refused.

    Raises:
        InputError: the URL is none, or what it names is not there though it should be, a
            directory, not writable, not a database, damaged, another program's, or of a newer
            version.
    """
    parsed = parse_url(url)
    source = shown(parsed)
    if is_sqlite(parsed):
        path = sqlite_path(parsed)
        if path.is_dir():
            raise InputError(source, "is a directory", "give a file in it")
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
            # Through the reader first: the writer's pragmas would already change a strange file.
            with _looking(parsed) as connection:
                schema.refuse_foreign(connection, source)
                if not create and schema.current(connection) is None:
                    raise InputError(source, "holds no Slipstream database", "check the path")
        with engine.begin() as connection:
            schema.upgrade(connection)
    except DBAPIError as error:
        engine.dispose()
        raise unusable(source, error) from None
    except BaseException:
        engine.dispose()
        raise
    return Database(engine, source)


@contextmanager
def _looking(url: URL) -> Iterator[Connection]:
    engine = reader_engine(url)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


def unusable(source: str, error: DBAPIError) -> InputError:
    """The line that tells a user why a database cannot be opened."""
    reason = str(error.orig).strip()
    mend = {
        "file is not a database": "give another file, or move this one away",
        "database disk image is malformed": "restore it from a backup, or move it away",
        "unable to open database file": "check the path and its permissions",
        "attempt to write a readonly database": "make the file and its folder writable",
        "database is locked": "stop the other program that is writing to it",
    }.get(reason, "check the database")
    return InputError(source, reason, mend)
