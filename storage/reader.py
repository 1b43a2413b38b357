"""The reader: never writes and never creates the file, which may appear later."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

from sqlalchemy import Engine, Select, func, or_, select
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session, selectinload

from slipstream.errors import InputError
from slipstream.messages import CycleReport, OrderState, SegmentState, VehiclePlan
from slipstream.orders import IN_FORCE, ORDER_STATES, OrderChange, OrderRecord, PlanRecord
from storage import fleet, inputs, jobs, schema
from storage.engine import (
    StorageError,
    display_name,
    is_sqlite,
    parse_url,
    reader_engine,
    sqlite_path,
)
from storage.inputs import CycleInputs
from storage.jobs import QuantumJob
from storage.models import CycleRow, PlanRow, StateRow
from storage.rows import cycle_report, segment_state, vehicle_plan
from storage.tables import Tables


@dataclass(frozen=True)
class StoredCycle:
    """One cycle with all that was stored of it.

    Attributes:
        report: of it.
        plans: that it sent, by vehicle.
        states: that it used.
        inputs: None: they are not stored, or not any more.
    """

    report: CycleReport
    plans: tuple[VehiclePlan, ...]
    states: tuple[SegmentState, ...]
    inputs: CycleInputs | None


class Reader:
    """Reads stored cycles, plans and states as messages; a context manager.

    Each call sees one committed state of the database. Results are empty while the file does not
    exist or has no schema yet. Every call raises `StorageError` if the database cannot be read.
    """

    def __init__(self, engine: Engine, url: str) -> None:
        self._engine = engine
        self._url = parse_url(url)

    def latest_cycle(self) -> CycleReport | None:
        """The cycle with the highest number; None before the first."""
        cycles = self.cycles(limit=1)
        return cycles[-1] if cycles else None

    def latest_plans(self) -> tuple[VehiclePlan, ...]:
        """The plans of the latest cycle with plans, and the latest in force of each other vehicle:
        one that is on its way gets a plan only where something changes. Ordered by vehicle.
        """
        latest = select(func.max(PlanRow.cycle)).scalar_subquery()
        query = (
            select(PlanRow)
            .where(or_(PlanRow.cycle == latest, PlanRow.status.in_(IN_FORCE)))
            .order_by(PlanRow.vehicle, PlanRow.cycle)
        )
        with self._read_session() as session:
            plans = {row.vehicle: row for row in _all(session, query)}
            return tuple(vehicle_plan(row) for row in plans.values())

    def cycles(self, limit: int, before: int | None = None) -> tuple[CycleReport, ...]:
        """The last ``limit`` cycles, or the last ones before a number; oldest first."""
        query = (
            select(CycleRow)
            .options(selectinload(CycleRow.solver_runs), selectinload(CycleRow.gates))
            .order_by(CycleRow.cycle.desc())
            .limit(limit)
        )
        if before is not None:
            query = query.where(CycleRow.cycle < before)
        with self._read_session() as session:
            return tuple(cycle_report(row) for row in reversed(_all(session, query)))

    def stored_cycle(self, cycle: int) -> StoredCycle | None:
        """One cycle; None: it is not stored."""
        with self._read_session() as session:
            row = None if session is None else session.get(CycleRow, cycle)
            if session is None or row is None:
                return None
            states = sorted(row.states, key=lambda state: (state.segment, state.rsu))
            return StoredCycle(
                cycle_report(row),
                tuple(vehicle_plan(plan) for plan in row.plans),
                tuple(segment_state(state) for state in states),
                inputs.load(session, cycle),
            )

    def plan(self, cycle: int, vehicle: str) -> VehiclePlan | None:
        """A vehicle's plan from a cycle; None: it is not stored."""
        with self._read_session() as session:
            row = None if session is None else session.get(PlanRow, (cycle, vehicle))
            return None if row is None else vehicle_plan(row)

    def cycle(self, number: int) -> CycleReport | None:
        """One cycle; None: it is not stored."""
        found = self.cycles(1, before=number + 1)
        return found[0] if found and found[0].cycle == number else None

    def plans(self, cycle: int) -> tuple[VehiclePlan, ...]:
        """The plans that a cycle published, ordered by vehicle."""
        query = select(PlanRow).where(PlanRow.cycle == cycle).order_by(PlanRow.vehicle)
        with self._read_session() as session:
            return tuple(vehicle_plan(row) for row in _all(session, query))

    def plans_of(
        self, vehicle: str, limit: int, before: int | None = None
    ) -> tuple[PlanRecord, ...]:
        """The last ``limit`` plans of a vehicle, or the last ones of cycles before a number, and
        what became of them; latest first.
        """
        with self._read_session() as session:
            return () if session is None else tuple(fleet.plans(session, vehicle, limit, before))

    def states(self, cycle: int) -> tuple[SegmentState, ...]:
        """The segment states that a cycle used, ordered by segment."""
        query = (
            select(StateRow).where(StateRow.cycle == cycle).order_by(StateRow.segment, StateRow.rsu)
        )
        with self._read_session() as session:
            return tuple(segment_state(row) for row in _all(session, query))

    def jobs(self, limit: int) -> tuple[QuantumJob, ...]:
        """The last ``limit`` quantum jobs, latest first."""
        with self._read_session() as session:
            return () if session is None else tuple(jobs.latest(session, limit))

    def orders(self, states: Collection[OrderState] = ORDER_STATES) -> tuple[OrderRecord, ...]:
        """Orders in some states, those that changed last at the end."""
        with self._read_session() as session:
            return () if session is None else tuple(fleet.orders(session, states))

    def order_changes(self, order: str) -> tuple[OrderChange, ...]:
        """The life of one order; empty if it is not known."""
        with self._read_session() as session:
            return () if session is None else tuple(fleet.changes(session, order))

    @contextmanager
    def tables(self) -> Iterator[Tables]:
        """All tables in one committed state, for as long as the block lasts.

        Meanwhile an SQLite database's log cannot be copied back, and grows with what is written.

        Raises:
            InputError: there is no database yet.
        """
        if not self.exists():
            source = display_name(self._url)
            raise InputError(source, "no database there", "give the dispatcher's database_url")
        with self._read_session() as session:
            assert session is not None
            yield Tables(session.connection())

    def exists(self) -> bool:
        """Whether there is a database with a schema yet."""
        with self._read_session() as session:
            return session is not None

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _read_session(self) -> Iterator[Session | None]:
        """A session in one read transaction; None while there is no schema yet."""
        if is_sqlite(self._url) and not sqlite_path(self._url).is_file():
            yield None
            return
        source = display_name(self._url)
        try:
            with Session(self._engine) as session:
                schema.check_ownership(session.connection(), source)
                revision = schema.current(session.connection())
                if revision is None:
                    yield None
                elif revision != schema.head():
                    raise StorageError(f"{source}: its writer has not upgraded it yet")
                else:
                    yield session
        except (DBAPIError, InputError) as error:
            reason = error.orig if isinstance(error, DBAPIError) else error
            raise StorageError(f"{source}: {reason}") from error
        except (ValueError, TypeError) as error:
            # Damage inside a value: the file is sound, but it is no message any more.
            raise StorageError(f"{source}: a row cannot be read: {str(error)[:200]}") from error


def _all(session: Session | None, query: Select[Any]) -> Sequence[Any]:
    return session.scalars(query).all() if session is not None else ()


def open_reader(url: str) -> Reader:
    """Open a database for reading; it need not exist yet.

    Raises:
        InputError: the URL is invalid, or its driver is not installed.
    """
    return Reader(reader_engine(parse_url(url)), url)
