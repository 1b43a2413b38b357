"""Which cycles are deleted, by age and by size, and the room that deleting needs on a full disk."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from sqlalchemy import ColumnElement, delete, func, literal, select, text
from sqlalchemy.orm import Session

from slipstream.errors import InputError
from storage.engine import is_sqlite, log_path, parse_url, sqlite_path
from storage.models import Base, ClockRow, CycleRow
from storage.records import inputs

MAX_CLOCK_GAP_DAYS: Final = 7.0
"""A clock further ahead of the trusted time than this is not trusted, days."""
RESERVE_BYTES: Final = 8 * 2**20
"""Size of the reserve file. It holds a full write-ahead log and one batch of deletions."""
LOG_BYTES: Final = 8 * 2**20
"""Room for the write-ahead log in a limit of size: SQLite empties it when it reaches 4 MB."""
BATCH_BYTES: Final = 2 * 2**20
"""Data deleted in one transaction, and pages given back in one; the log grows by some more."""
PRUNE_BATCH: Final = 200
"""Cycles deleted in one transaction, at most; a cycle to be recorded waits for one."""
SAMPLED_PAGES: Final = 64
"""Pages of each table of a PostgreSQL database from which its live rows are estimated."""
FREE_SHARE: Final = 0.05
"""Share of a limit of size that is kept free in the file, for cycles to come."""

_DAY_NS: Final = 86_400e9
_ROW_BYTES: Final = 32
"""What PostgreSQL stores of each row beside its columns, about."""


class UntrustedClockError(InputError):
    """This machine's clock is too far ahead of the cycles stored; nothing is deleted by age."""


def note_time(session: Session, started_ns: int) -> None:
    """Move the trusted time on to a cycle's, unless the clock has jumped ahead or back."""
    trusted_ns = _trusted_ns(session)
    if trusted_ns is None or 0 < started_ns - trusted_ns <= MAX_CLOCK_GAP_DAYS * _DAY_NS:
        set_time(session, started_ns)


def set_time(session: Session, now_ns: int) -> None:
    """Make ``now_ns`` the trusted time."""
    session.merge(ClockRow(id=1, trusted_ns=now_ns))


def check_clock(session: Session, now_ns: int, source: str) -> None:
    """Check that the clock may be used to tell the age of cycles.

    Raises:
        UntrustedClockError: it is more than `MAX_CLOCK_GAP_DAYS` ahead of the trusted time.
    """
    trusted_ns = _trusted_ns(session)
    gap_days = 0.0 if trusted_ns is None else (now_ns - trusted_ns) / _DAY_NS
    if gap_days > MAX_CLOCK_GAP_DAYS:
        raise UntrustedClockError(
            source,
            f"the clock is {gap_days:.0f} days ahead of the newest cycle with a trusted time, so "
            "none is deleted for its age",
            "set the clock; if it is right, let the dispatcher run for a day, or say so: "
            "slipstream db prune --trust-clock",
        )


def _trusted_ns(session: Session) -> int | None:
    return session.scalar(select(ClockRow.trusted_ns))


def first_kept(session: Session, before_ns: int, now_ns: int) -> int | None:
    """Number of the first cycle that stays when those before ``before_ns`` go; None: no cycle.

    A cycle that began before stays if one with a lower number has to stay: the clock was behind
    when it was recorded. Those of the future say nothing of the others' age.
    """
    young = select(func.min(CycleRow.cycle)).where(
        CycleRow.started_ns >= before_ns, CycleRow.started_ns <= now_ns
    )
    number: int | None = session.scalar(young)
    return session.scalar(select(func.max(CycleRow.cycle))) if number is None else number


def delete_cycles(session: Session, limit: int, below: int, before_ns: int | None = None) -> int:
    """Delete the cycles with the lowest numbers; returns how many.

    Args:
        below: only cycles with lower numbers.
        before_ns: only cycles that began before; None: whenever they began.
    """
    query = select(CycleRow.cycle).where(CycleRow.cycle < below)
    if before_ns is not None:
        query = query.where(CycleRow.started_ns < before_ns)
    numbers: Sequence[int] = session.scalars(query.order_by(CycleRow.cycle).limit(limit)).all()
    if numbers:
        session.execute(delete(CycleRow).where(CycleRow.cycle.in_(numbers)))
        inputs.drop_unused(session)
    return len(numbers)


@dataclass(frozen=True)
class Pages:
    """Pages of a database's files.

    Attributes:
        size: bytes of a page.
        count: number of pages.
        free: number of pages that hold nothing.
        beside: bytes of the files beside them that a limit of size is for, too.
    """

    size: int
    count: int
    free: int
    beside: int = 0

    @property
    def used(self) -> int:
        """Number of pages that hold something."""
        return self.count - self.free

    def limit(self, keep_mb: float) -> int:
        """Number of pages that fit into ``keep_mb`` with what is beside them; at least 1."""
        return max(1, int((keep_mb * 1e6 - self.beside) // self.size))

    def wanted(self, keep_mb: float) -> int:
        """Number of pages in use above which cycles are deleted: `limit` less `FREE_SHARE`."""
        return int(self.limit(keep_mb) * (1 - FREE_SHARE))


def read_pages(cursor: sqlite3.Cursor) -> Pages:
    """Pages of the SQLite file that a cursor reads, beside its log and its reserve."""
    names = ("page_size", "page_count", "freelist_count")
    size, count, free = (cursor.execute(f"PRAGMA {name}").fetchone()[0] for name in names)
    return Pages(size, count, free, LOG_BYTES + RESERVE_BYTES)


def read_server_pages(session: Session, keep_mb: float) -> Pages:
    """Pages of a PostgreSQL database's files; free is what holds no live row.

    Files never shrink, but rows that come take the place of deleted ones. The live rows of each
    table are estimated from `SAMPLED_PAGES` pages: their part of it, its indexes included. Files
    that fit into ``keep_mb`` anyway count whole.
    """
    page = int(session.scalar(text("SELECT current_setting('block_size')")))
    whole = int(session.scalar(text("SELECT pg_database_size(current_database())")))
    files = Pages(page, whole // page, 0)
    if files.used <= files.wanted(keep_mb):
        return files
    tables = Base.metadata.tables
    listing = text(
        "SELECT relname, pg_relation_size(oid), pg_table_size(oid), pg_total_relation_size(oid) "
        "FROM pg_class WHERE relkind = 'r' AND relname = ANY(:names) AND pg_table_is_visible(oid)"
    )
    sizes = {
        name: found
        for name, *found in session.execute(listing, {"names": list(tables)})
        if found[0]
    }
    used = float(whole - sum(total for _, _, total in sizes.values()))
    for name, (own, table, total) in sizes.items():
        sampled = min(SAMPLED_PAGES, own // page)
        row: ColumnElement[int] = literal(_ROW_BYTES)
        for column in tables[name].c:
            row = row + func.coalesce(func.pg_column_size(column), 0)
        # By the places that rows can have on them, as the server draws no fixed number of pages.
        query = select(func.sum(row)).where(
            text(
                "ctid = ANY (ARRAY(SELECT format('(%s,%s)', number * :pages / :sampled, place)::tid"
                " FROM generate_series(0, :sampled - 1) number, generate_series(1, :places) place))"
            )
        )
        places = {"pages": own // page, "sampled": sampled, "places": page // _ROW_BYTES}
        live = (session.scalar(query, places) or 0) * (own / page / sampled)
        used += total * min(1.0, float(live) / table)
    return replace(files, free=(whole - int(used)) // page)


@dataclass(frozen=True)
class Room:
    """Room of an SQLite database.

    Attributes:
        size_bytes: its file, log and reserve.
        free_bytes: what is left on its disk.
    """

    size_bytes: int
    free_bytes: int


def read_room(path: Path) -> Room | None:
    """The room of an SQLite file; None: it cannot be read."""
    place = path.resolve()
    try:
        parts = (place, log_path(place), reserve_path(path))
        size = sum(part.stat().st_size for part in parts if part.exists())
        return Room(size, shutil.disk_usage(place.parent).free)
    except OSError:
        return None


def reserve_path(path: Path) -> Path:
    """The reserve file of an SQLite file."""
    place = path.resolve()
    return place.with_name(place.name + "-reserve")


def make_reserve(path: Path) -> bool:
    """Make the reserve file where it is missing; False if there is no room for it."""
    reserve = reserve_path(path)
    if reserve.exists() and reserve.stat().st_size >= RESERVE_BYTES:
        return True
    try:
        with reserve.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
    except OSError:
        reserve.unlink(missing_ok=True)
        return False
    return True


@contextmanager
def headroom(url: str) -> Iterator[None]:
    """Give a full disk the room of the reserve file, and take it again at the end.

    Deleting needs room first: the write-ahead log and its index. Open the database inside.

    Raises:
        InputError: the URL is invalid.
    """
    parsed = parse_url(url)
    if not is_sqlite(parsed) or not sqlite_path(parsed).is_file():
        yield
        return
    path = sqlite_path(parsed)
    reserve_path(path).unlink(missing_ok=True)
    try:
        yield
    finally:
        make_reserve(path)
