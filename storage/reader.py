"""The reader: never writes and never creates the file, which may appear later."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal, Self, TypeVar

from sqlalchemy import Engine, func, or_, select
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session, selectinload

from slipstream.energy.ledger import EnergyHour, EnergySum
from slipstream.errors import InputError
from slipstream.messages import CycleReport, OrderState, SegmentCounts, SegmentState, VehiclePlan
from slipstream.orders import (
    IN_FORCE,
    ORDER_STATES,
    OrderChange,
    OrderRecord,
    PlanChange,
    PlanRecord,
)
from storage import schema
from storage.engine import (
    StorageError,
    display_name,
    is_sqlite,
    parse_url,
    reader_engine,
    sqlite_path,
)
from storage.models import CycleRow, PlanRow
from storage.records import energy_ledger, events, fleet, inputs, jobs, past
from storage.records.events import Event
from storage.records.inputs import CycleInputs
from storage.records.jobs import QuantumJob
from storage.records.past import CycleSums, OrderEnd
from storage.rows import cycle_report, vehicle_plan
from storage.tables import Tables
from storage.traffic import counts, history, recent, rollup_table
from storage.traffic.history import SegmentAt
from storage.traffic.rollups import MINUTE_S, RollUp

T = TypeVar("T")


@dataclass(frozen=True)
class StoredCycle:
    """One cycle with all that was stored of it.

    Attributes:
        report: of it.
        plans: that it sent, by vehicle.
        inputs: None: they are not stored, or not any more.
    """

    report: CycleReport
    plans: tuple[VehiclePlan, ...]
    inputs: CycleInputs | None


class Reader:
    """Reads stored cycles, plans and states as messages; a context manager.

    Each call sees one committed state of the database. Results are empty while the file does not
    exist or has no schema yet. Every call raises `StorageError` if the database cannot be read.
    Times are UTC ns; a range has its begin and not its end.
    """

    def __init__(self, engine: Engine, url: str) -> None:
        self._engine = engine
        self._url = parse_url(url)

    def latest_cycle(self) -> CycleReport | None:
        """The cycle with the highest number; None before the first."""
        cycles = self.cycles(limit=1)
        return cycles[-1] if cycles else None

    def latest_plan_records(self) -> tuple[PlanRecord, ...]:
        """The plans of the latest cycle with plans, and the latest in force of each other vehicle:
        one that is on its way gets a plan only where something changes. Ordered by vehicle.
        """
        latest = select(func.max(PlanRow.cycle)).scalar_subquery()
        query = (
            select(PlanRow)
            .where(or_(PlanRow.cycle == latest, PlanRow.status.in_(IN_FORCE)))
            .order_by(PlanRow.vehicle, PlanRow.cycle)
        )

        def read(session: Session) -> tuple[PlanRecord, ...]:
            plans = {row.vehicle: row for row in session.scalars(query)}
            return tuple(map(fleet.as_plan, plans.values()))

        return self._read((), read)

    def cycles(
        self,
        limit: int,
        before: int | None = None,
        *,
        gates: bool = True,
        begin_ns: int | None = None,
        end_ns: int | None = None,
    ) -> tuple[CycleReport, ...]:
        """The last ``limit`` cycles, or the last ones before a number; oldest first.

        Gates of cycles that are older than `storage.upkeep.STATES_KEPT_H` have no age and no speed.

        Args:
            limit: maximum number of cycles.
            before: number that theirs are below; None: of all.
            gates: False: only the last cycle has its gates.
            begin_ns: of the range in which they began; None: open.
            end_ns: likewise.
        """
        query = (
            select(CycleRow)
            .options(selectinload(CycleRow.solver_runs))
            .order_by(CycleRow.cycle.desc())
            .limit(limit)
        )
        if before is not None:
            query = query.where(CycleRow.cycle < before)
        if begin_ns is not None:
            query = query.where(CycleRow.started_ns >= begin_ns)
        if end_ns is not None:
            query = query.where(CycleRow.started_ns < end_ns)

        def read(session: Session) -> tuple[CycleReport, ...]:
            rows = session.scalars(query).all()[::-1]
            with_gates = [row.cycle for row in (rows if gates else rows[-1:])]
            of_cycles = history.gates_of(session, with_gates)
            return tuple(cycle_report(row, of_cycles.get(row.cycle, ())) for row in rows)

        return self._read((), read)

    def stored_cycle(self, cycle: int) -> StoredCycle | None:
        """One cycle; None: it is not stored."""

        def read(session: Session) -> StoredCycle | None:
            row = session.get(CycleRow, cycle)
            if row is None:
                return None
            gates = history.gates_of(session, [cycle]).get(cycle, ())
            plans = tuple(vehicle_plan(plan) for plan in row.plans)
            return StoredCycle(cycle_report(row, gates), plans, inputs.load(session, cycle))

        return self._read(None, read)

    def cycle_record(self, cycle: int) -> bytes | None:
        """What a cycle recorded (`CycleInputs.record`); None: it is not stored, or not any more.

        Raises:
            ValueError: it is damaged.
        """
        return self._read(None, lambda session: inputs.record(session, cycle))

    def plan(self, cycle: int, vehicle: str) -> VehiclePlan | None:
        """A vehicle's plan from a cycle; None: it is not stored."""

        def read(session: Session) -> VehiclePlan | None:
            row = session.get(PlanRow, (cycle, vehicle))
            return None if row is None else vehicle_plan(row)

        return self._read(None, read)

    def cycle(self, number: int) -> CycleReport | None:
        """One cycle; None: it is not stored."""
        found = self.cycles(1, before=number + 1)
        return found[0] if found and found[0].cycle == number else None

    def plans(self, cycle: int) -> tuple[VehiclePlan, ...]:
        """The plans that a cycle published, ordered by vehicle."""
        query = select(PlanRow).where(PlanRow.cycle == cycle).order_by(PlanRow.vehicle)
        return self._read((), lambda session: tuple(map(vehicle_plan, session.scalars(query))))

    def plans_of(
        self, vehicle: str, limit: int, before: int | None = None
    ) -> tuple[PlanRecord, ...]:
        """The last ``limit`` plans of a vehicle, or the last ones of cycles before a number, and
        what became of them; latest first.
        """
        return self._read((), lambda session: fleet.plans(session, vehicle, limit, before))

    def plan_changes(self, vehicle: str, cycles: Collection[int]) -> tuple[PlanChange, ...]:
        """Changes of the status of a vehicle's plans from some cycles, by cycle, the first one
        first.
        """
        return self._read((), lambda session: fleet.plan_changes(session, vehicle, cycles))

    def states(self, cycle: int) -> tuple[SegmentState, ...]:
        """The segment states that a cycle used, by segment and RSU.

        Empty for cycles older than `storage.upkeep.STATES_KEPT_H`; see `segments_at`.
        """
        return self._read((), lambda session: recent.states(session, cycle))

    def segments_at(self, time_ns: int) -> tuple[SegmentAt, ...]:
        """Gate and features of every watched segment at a moment of the kept past, by segment;
        empty before the first cycle that is kept. Gates hold for
        `storage.traffic.history.GATES_HOLD_S` after a cycle.
        """
        return self._read((), lambda session: history.segments_at(session, time_ns))

    def rollups(
        self, segment: str, begin_ns: int, end_ns: int, *, period_s: Literal[60, 3600] = MINUTE_S
    ) -> tuple[RollUp, ...]:
        """What was reported of a segment in the minutes or hours that begin in a range of time,
        oldest first. Periods without a state are missing, and so is an hour that has not ended.
        Minutes are kept for `storage.upkeep.MINUTES_KEPT_H`.
        """

        def read(session: Session) -> tuple[RollUp, ...]:
            return tuple(rollup_table.of_segment(session, segment, begin_ns, end_ns, period_s))

        return self._read((), read)

    def counts(self, segment: str, begin_ns: int, end_ns: int) -> tuple[SegmentCounts, ...]:
        """Vehicles that passed on a segment in the complete quarter hours that begin in a range of
        time, oldest first, then by RSU.
        """
        return self._read(
            (), lambda session: tuple(counts.of_segment(session, segment, begin_ns, end_ns))
        )

    def energy(
        self, begin_ns: int, end_ns: int, *, vehicle: str | None = None
    ) -> tuple[EnergyHour, ...]:
        """What vehicles have driven by the plans in force, by hour and vehicle, in the hours that
        begin in a range of time; of one vehicle or all.
        """
        return self._read(
            (), lambda session: tuple(energy_ledger.hours(session, begin_ns, end_ns, vehicle))
        )

    def energy_sums(
        self,
        begin_ns: int,
        end_ns: int,
        *,
        by: Literal["hour", "day", "all"],
        vehicle: str | None = None,
    ) -> tuple[EnergySum, ...]:
        """The same of all vehicles together, oldest first; nothing for periods without a row.

        Args:
            by: period of a sum; days are those of UTC, and all is one sum.
            vehicle: only this one's; None: all.
        """
        return self._read(
            (), lambda session: tuple(energy_ledger.sums(session, begin_ns, end_ns, by, vehicle))
        )

    def jobs(self, limit: int) -> tuple[QuantumJob, ...]:
        """The last ``limit`` quantum jobs, latest first."""
        return self._read((), lambda session: jobs.latest(session, limit))

    def orders(
        self,
        states: Collection[OrderState] = ORDER_STATES,
        *,
        ended_since_ns: int | None = None,
    ) -> tuple[OrderRecord, ...]:
        """Orders in some states, those that changed last at the end; of those that have ended,
        only such as did at ``ended_since_ns`` or later; None: all.
        """
        return self._read((), lambda session: fleet.orders(session, states, ended_since_ns))

    def order_changes(self, order: str) -> tuple[OrderChange, ...]:
        """The life of one order; empty if it is not known."""
        return self._read((), lambda session: fleet.changes(session, order))

    def span(self) -> tuple[int, int] | None:
        """The kept past: from the first stored cycle's begin to that of the last one, or to
        the last change of an order if that is later; None: there is no cycle.
        """
        return self._read(None, past.span)

    def cycle_at(self, time_ns: int) -> int | None:
        """Number of the last cycle that had begun at a moment; None: none had."""
        return self._read(None, lambda session: past.cycle_at(session, time_ns))

    def plans_at(self, time_ns: int) -> tuple[PlanRecord, ...]:
        """The plan that each vehicle had at a moment, by vehicle; where none was in force any more,
        its last one with what had become of it. Plans older than `PLANS_LAST_S` are
        not looked for.
        """
        return self._read((), lambda session: past.plans_at(session, time_ns))

    def orders_at(self, time_ns: int, limit: int = 5000) -> tuple[OrderRecord, ...]:
        """Orders at a moment that had not ended, or ended within a day before; those that changed
        last at the end. Of more than ``limit`` only the newest. `pinned` is not kept and None.
        """
        return self._read((), lambda session: past.orders_at(session, time_ns, limit))

    def order_ends(self, begin_ns: int, end_ns: int) -> tuple[OrderEnd, ...]:
        """The orders that ended in a range of time, in its order."""
        return self._read((), lambda session: past.order_ends(session, begin_ns, end_ns))

    def cycle_sums(self, begin_ns: int, end_ns: int) -> CycleSums:
        """What the cycles did that began in a range of time."""
        nothing = CycleSums({}, 0.0, 0.0, 0)
        return self._read(nothing, lambda session: past.cycle_sums(session, begin_ns, end_ns))

    def last_energy(self, time_ns: int) -> CycleReport | None:
        """The last cycle at a moment whose plans drove at all, without its gates; None: none."""

        def read(session: Session) -> CycleReport | None:
            row = past.last_with_energy(session, time_ns)
            return None if row is None else cycle_report(row)

        return self._read(None, read)

    def state_counts(self, begin_ns: int, end_ns: int) -> Mapping[str, tuple[int, int]]:
        """States of each segment in the hours that begin in a range of time, and those of them
        with features; of an hour that has not ended, what came until now.
        """
        return self._read({}, lambda session: rollup_table.counts(session, begin_ns, end_ns))

    def events(
        self, begin_ns: int, end_ns: int, *, limit: int, before: int | None = None
    ) -> tuple[Event, ...]:
        """What operators were told of in a range of time, latest first: alarms by their begin, and
        what was done by whom; at most ``limit``, with numbers below ``before`` if it is given.
        """
        return self._read(
            (), lambda session: events.between(session, begin_ns, end_ns, limit, before)
        )

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

    def _read(self, nothing: T, read: Callable[[Session], T]) -> T:
        """What is read in one transaction; ``nothing`` while there is no schema yet."""
        with self._read_session() as session:
            return nothing if session is None else read(session)

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
                elif revision != schema.HEAD:
                    raise StorageError(f"{source}: its writer has not upgraded it yet")
                else:
                    yield session
        except (DBAPIError, InputError) as error:
            reason = error.orig if isinstance(error, DBAPIError) else error
            raise StorageError(f"{source}: {reason}") from error
        except (ValueError, TypeError) as error:
            # Damage inside a value: the file is sound, but it is no message any more.
            raise StorageError(f"{source}: a row cannot be read: {str(error)[:200]}") from error


def open_reader(url: str) -> Reader:
    """Open a database for reading; it need not exist yet.

    Raises:
        InputError: the URL is invalid, or its driver is not installed.
    """
    return Reader(reader_engine(parse_url(url)), url)
