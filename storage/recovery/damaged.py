"""A damaged file at a dispatcher's start: it is set aside, and a new database takes its place.

Vehicles refuse plans of lower cycles than they know, so that numbers go on above those of before.
Orders, vehicles and plans in force are taken over if all of them can still be read; so is what
operators did, as a dispatcher that is paused has to stay so, and alarms in force.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import TypeVar

from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from slipstream.orders import FleetRecords
from storage import schema
from storage.database import Database, open_database
from storage.engine import is_sqlite, parse_url, reader_engine, sqlite_path
from storage.opening import DamagedError
from storage.ownership import FileOwner
from storage.records import events, fleet
from storage.recovery import files
from storage.recovery.backup import NUMBERS_LEFT_OUT, empty_report
from storage.retention import reserve_path

log = logging.getLogger(__name__)

T = TypeVar("T")


def open_or_set_aside(url: str) -> Database:
    """Open the database as its one dispatcher; a damaged file is kept as ``{name}-corrupt-{UTC}``.

    `Database.set_aside` says where it is. Only a file that a dispatcher has written is set aside:
    its reserve file tells. The path may be wrong otherwise.

    Raises:
        InputError: as `open_database`.
        StorageError: likewise.
    """
    try:
        return open_database(url, owned=True)
    except DamagedError as error:
        parsed = parse_url(url)
        if not is_sqlite(parsed) or not reserve_path(sqlite_path(parsed)).exists():
            raise
        aside = _set_aside(sqlite_path(parsed), error)
    database = open_database(url, owned=True)
    database.set_aside = aside
    return database


def _set_aside(path: Path, error: DamagedError) -> Path:
    owner = FileOwner(path)
    try:
        place = path.resolve()
        now_ns = time.time_ns()
        highest = files.highest_cycle(place)
        # No dispatcher has made more cycles than seconds have passed since 1970.
        number = now_ns // 10**9 if highest is None else highest + NUMBERS_LEFT_OUT
        records = _readable(place, lambda session: fleet.load(session, now_ns))
        told = _readable(place, lambda session: tuple(events.lasting(session)))
        with files.new_file(place) as part:
            with open_database(f"sqlite:///{part}") as database:
                if records is not None:
                    _take_over(database, records)
                if told:
                    database.save_events(told)
                line = f"the database of before {error.problem}"[:500]
                database.record_cycle(empty_report(number, now_ns, line), [], [])
            aside = files.replace(place, part, "corrupt")
    finally:
        owner.close()
    assert aside is not None
    log.error(
        "%s: it was set aside as %s, and a new database begins with cycle %d; orders, vehicles "
        "and plans in force %s; alarms and whether it is paused %s",
        error,
        aside.name,
        number + 1,
        *("could not be read" if found is None else "were taken over" for found in (records, told)),
    )
    return aside


def _readable(path: Path, read: Callable[[Session], T]) -> T | None:
    """What is read of a damaged file; None if not all of it can be."""
    engine = reader_engine(parse_url(f"sqlite:///{path}"))
    try:
        with Session(engine) as session:
            if schema.current(session.connection()) != schema.HEAD:
                return None
            return read(session)
    except (DBAPIError, ValueError, TypeError):
        return None
    finally:
        engine.dispose()


def _take_over(database: Database, records: FleetRecords) -> None:
    plans = sorted(records.plans, key=lambda record: record.plan.cycle)
    for cycle, of_cycle in groupby(plans, key=lambda record: record.plan.cycle):
        with_energies = {record.plan.vehicle: record for record in of_cycle}
        some = [record.plan for record in with_energies.values()]
        energies = {v: r.energy for v, r in with_energies.items() if r.energy is not None}
        report = empty_report(cycle, some[0].issued_ns, "taken over from a damaged file", len(some))
        database.record_cycle(report, some, [], energies=energies)
    database.save_fleet(records)
