"""The integrity check behind `slipstream db check`."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import func, select
from sqlalchemy.exc import DBAPIError

from slipstream.errors import InputError
from storage import schema
from storage.engine import (
    display_name,
    is_sqlite,
    parse_url,
    reader_engine,
    sqlite_faults,
    sqlite_path,
)
from storage.models import CycleRow
from storage.opening import open_error


@dataclass(frozen=True)
class CheckReport:
    """What `check` found.

    Attributes:
        database: the file, or the URL without its password.
        schema_version: revision of its schema; None if it has none yet.
        schema_head: revision that this program writes.
        faults: findings of the integrity and foreign key checks; empty if there are none.
        cycles: cycles stored.
        first_ns: UTC ns at which the oldest cycle began; None without cycles.
        last_ns: UTC ns at which the newest cycle began; None without cycles.
        size_bytes: size of the SQLite file; None for other databases.
    """

    database: str
    schema_version: str | None
    schema_head: str
    faults: tuple[str, ...]
    cycles: int
    first_ns: int | None
    last_ns: int | None
    size_bytes: int | None

    @property
    def ok(self) -> bool:
        """True if the schema is current and no fault was found."""
        return self.schema_version == self.schema_head and not self.faults


def check(url: str) -> CheckReport:
    """Read the whole database once and report faults; changes nothing.

    Raises:
        InputError: there is no such file, it is not a Slipstream database, or a newer version wrote
            it.
        StorageError: there is no room for the log's index, or the disk has a fault.
    """
    parsed = parse_url(url)
    source = display_name(parsed)
    size = None
    if is_sqlite(parsed):
        path = sqlite_path(parsed)
        if not path.is_file():
            what = "is a directory" if path.is_dir() else "no such file"
            raise InputError(source, what, "check the path")
        size = path.stat().st_size
    engine = reader_engine(parsed)
    version, faults, cycles, first, last = None, [], 0, None, None
    try:
        with engine.begin() as connection:
            schema.check_ownership(connection, source)
            version = schema.current(connection)
            if is_sqlite(parsed):
                faults = sqlite_faults(connection)
            if version is not None and not faults:
                cycles, first, last = connection.execute(
                    select(
                        func.count(), func.min(CycleRow.started_ns), func.max(CycleRow.started_ns)
                    ).select_from(CycleRow)
                ).one()
    except DBAPIError as error:
        if "malformed" not in str(error.orig):
            raise open_error(source, error) from None
        faults = [str(error.orig)]
    finally:
        engine.dispose()
    return CheckReport(source, version, schema.HEAD, tuple(faults), cycles, first, last, size)
