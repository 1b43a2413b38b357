"""Numbers of segments, which the tables of traffic have in place of names."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import func, insert, select
from sqlalchemy.orm import Session

from storage.traffic.models import segments


def ids(session: Session, wanted: Iterable[str]) -> dict[str, int]:
    """Numbers of at least these segments by name; new names are given the next ones."""
    known = {name: number for number, name in names(session).items()}
    missing = sorted(set(wanted) - known.keys())
    if missing:
        first = (session.scalar(select(func.max(segments.c.id))) or 0) + 1
        new = {name: first + place for place, name in enumerate(missing)}
        session.execute(
            insert(segments), [{"id": number, "segment": name} for name, number in new.items()]
        )
        known |= new
    return known


def names(session: Session) -> dict[int, str]:
    """Names of all segments by number."""
    rows = session.execute(select(segments.c.id, segments.c.segment))
    return {row.id: row.segment for row in rows}


def count(session: Session) -> int:
    """Number of segments."""
    return session.scalar(select(func.count()).select_from(segments)) or 0


def number_of(session: Session, name: str) -> int | None:
    """Number of one segment; None if nothing of it is stored."""
    return session.scalar(select(segments.c.id).where(segments.c.segment == name))
