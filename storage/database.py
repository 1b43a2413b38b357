"""The writer: one transaction a cycle, durable when `record_cycle` returns."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Final

from sqlalchemy import func, select
from sqlalchemy.exc import IntegrityError

from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import CycleReport, SegmentCounts, SegmentState, VehiclePlan
from slipstream.orders import FleetRecords, OrderRecord
from storage import retention
from storage.engine import OrderKnownError, display_name, parse_url, sqlite_path
from storage.models import CycleRow
from storage.opening import open_path
from storage.records import events, fleet, inputs, jobs
from storage.records.events import Event
from storage.records.inputs import CycleInputs
from storage.records.jobs import QuantumJob
from storage.rows import cycle_row
from storage.traffic import counts, gates, recent, rollup_table
from storage.traffic.gates import GateState
from storage.traffic.rollups import RollUp
from storage.upkeep import Upkeep

TURN_WITHIN_S: Final = 2.0
"""What callers' orders wait for others who write, s: a caller is told to try again rather than that
the whole fleet waits with it."""
CYCLE_WITHIN_S: Final = 10.0
"""What a cycle waits for them, s, while the fleet waits with it: then it ends without plans."""


class Database(Upkeep):
    """The dispatcher's database, open for writing; a context manager.

    Every call raises `StorageError` if the database cannot be read or written, or was busy for too
    long; of what it was to store nothing is stored then.
    """

    _gates: Mapping[str, GateState] | None = None
    """Gates as they are stored; None: not read yet."""
    set_aside: Path | None = None
    """Where a damaged file is that was in its place when it was opened."""

    def record_cycle(
        self,
        report: CycleReport,
        plans: Sequence[VehiclePlan],
        states: Sequence[SegmentState],
        records: FleetRecords | None = None,
        made_from: CycleInputs | None = None,
        energies: Mapping[str, PlanEnergy] | None = None,
    ) -> None:
        """Store a cycle with its plans and the segment states it used, all or nothing.

        Args:
            records: what has changed of orders, earlier plans and vehicles.
            made_from: its inputs.
            energies: of its plans, by vehicle; what is driven of them is booked by these.

        Raises:
            ValueError: a plan belongs to another cycle, or the cycle is already stored.
        """
        misplaced = [plan.vehicle for plan in plans if plan.cycle != report.cycle]
        if misplaced:
            raise ValueError(f"plans of another cycle than {report.cycle}: {misplaced}")
        row = cycle_row(report, plans, energies)
        with self._turn(CYCLE_WITHIN_S):
            self._record(row, report, states, records, made_from)

    def _record(
        self,
        row: CycleRow,
        report: CycleReport,
        states: Sequence[SegmentState],
        records: FleetRecords | None,
        made_from: CycleInputs | None,
    ) -> None:
        # A commit that fails may have been made all the same: then they are read anew.
        known, self._gates = self._gates, None
        try:
            with self._write_session(CYCLE_WITHIN_S) as session:
                session.add(row)
                session.flush()
                recent.save(session, report.cycle, report.gates, states)
                if known is None:
                    known = gates.at(session, report.cycle)
                if report.gates or report.status != "failed":
                    changed = gates.changes(known, gates.states_of(report.gates))
                    gates.save(session, report.cycle, changed)
                    known = {**known, **changed}
                if records is not None:
                    fleet.save(session, records)
                if made_from is not None:
                    inputs.save(session, report.cycle, made_from)
                retention.note_time(session, report.started_ns)
        except IntegrityError as error:
            raise ValueError(f"cycle {report.cycle} is refused: {error.orig}") from None
        self._gates = known

    def add_rollups(self, minutes: Sequence[RollUp]) -> None:
        """Store roll-ups of minutes, and make those of the hours that have ended with them."""
        with self._write_session() as session:
            rollup_table.add(session, minutes)

    def add_counts(self, quarter_hours: Sequence[SegmentCounts]) -> None:
        """Store complete counts; one that is stored already stays unless less was watched in it."""
        with self._write_session() as session:
            counts.save(session, quarter_hours)

    def next_cycle_number(self) -> int:
        """One above the highest cycle stored; 1 in an empty database.

        Where the database was found deleted, replaced or damaged, its path is opened anew first,
        with all checks of `open_database`.

        Raises:
            OwnedError: another process owns it by now.
        """
        self._open_anew()
        with self._write_session() as session:
            return (session.scalar(select(func.max(CycleRow.cycle))) or 0) + 1

    def load_fleet(self, now_ns: int) -> FleetRecords:
        """Orders, plans in force and vehicles as they were stored last."""
        with self._write_session() as session:
            return fleet.load(session, now_ns)

    def save_fleet(self, records: FleetRecords) -> None:
        """Store what has changed of orders, plans and vehicles beside a cycle."""
        with self._write_session(TURN_WITHIN_S) as session:
            fleet.save(session, records)

    def add_orders(self, records: FleetRecords) -> None:
        """Store orders that are new, and their changes, at least one of each.

        Raises:
            OrderKnownError: the id of one is stored already.
        """
        try:
            with self._write_session(TURN_WITHIN_S) as session:
                fleet.add_orders(session, records)
        except IntegrityError as error:
            raise OrderKnownError(f"{self._source}: {error.orig}") from None

    def find_orders(self, names: Collection[str]) -> tuple[OrderRecord, ...]:
        """Those of some orders that are stored, however long ago they ended."""
        with self._write_session(TURN_WITHIN_S) as session:
            return fleet.find(session, names)

    def save_events(self, changed: Sequence[Event]) -> None:
        """Store events. One of an alarm that is stored takes the place of what was stored of it."""
        with self._write_session(TURN_WITHIN_S) as session:
            events.save(session, changed)

    def load_alarms(self, ended_ns: int) -> tuple[Event, ...]:
        """Alarms in force and those that ended at ``ended_ns`` or later, UTC; oldest first."""
        with self._write_session() as session:
            return tuple(events.alarms(session, ended_ns))

    def last_event(self, kinds: Collection[str]) -> Event | None:
        """The event of some kinds that was stored last; None: there is none."""
        with self._write_session() as session:
            return events.last(session, kinds)

    def room(self) -> retention.Room | None:
        """Room of an SQLite database; None: it is on a server, or cannot be read."""
        url = self._engine.url
        return retention.read_room(sqlite_path(url)) if self._is_sqlite else None

    def save_job(self, job: QuantumJob) -> None:
        """Store the present record of a quantum job, durably."""
        with self._write_session() as session:
            jobs.save(session, job)

    def jobs_since(self, finished_ns: int) -> list[QuantumJob]:
        """Quantum jobs that are open or finished at ``finished_ns`` or later; oldest first."""
        with self._write_session() as session:
            return jobs.since(session, finished_ns)

    def _forget(self) -> None:
        super()._forget()
        self._gates = None


def open_database(url: str, *, create: bool = True, owned: bool = False) -> Database:
    """Open the database for writing, and upgrade its schema if it is older.

    Args:
        url: such as ``sqlite:////var/lib/slipstream/slipstream.db``.
        create: create a missing database; if False, a missing one is an error.
        owned: for the one dispatcher that writes its cycles: no other process may own it, and a
            commit to a file that was deleted or replaced is an error.

    Raises:
        InputError: the URL is invalid, or the database is missing (with ``create`` False), a
            directory, not writable, no database, damaged, another program's, written by another
            version, or owned by another process (with ``owned`` True).
        StorageError: there is no room, or the disk has a fault.
    """
    parsed = parse_url(url)
    return Database(display_name(parsed), lambda: open_path(parsed, create=create, owned=owned))
