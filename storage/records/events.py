"""Events: alarms from their begin to their end, and what operators did."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Final

from sqlalchemy import delete, func, or_, select
from sqlalchemy.orm import Session

from storage.models import EventRow
from storage.records.sums import chunks

BATCH: Final = 500
"""Events deleted in one transaction, at most."""


@dataclass(frozen=True)
class Event:
    """Something that operators are told of.

    Attributes:
        time_ns: when, UTC; of an alarm, its begin.
        kind: an alarm's kind, or what was done.
        severity: critical, warning or info.
        subject: as `slipstream.messages.Alarm` has it.
        text: in words.
        mend: what to do about it; None: nothing.
        actor: name of the token that did it; None: nobody did.
        alarm: id; None: it is no alarm.
        ended_ns: UTC of an alarm's end; None: it is in force, or no alarm.
        acknowledged_by: who has acknowledged it; None: nobody.
        acknowledged_ns: UTC of that.
        number: its place among all, later ones above; None: not stored yet.
    """

    time_ns: int
    kind: str
    severity: str
    subject: str
    text: str
    mend: str | None = None
    actor: str | None = None
    alarm: str | None = None
    ended_ns: int | None = None
    acknowledged_by: str | None = None
    acknowledged_ns: int | None = None
    number: int | None = None


def save(session: Session, changed: Sequence[Event]) -> None:
    """Store events; those of alarms that are stored are brought up to date."""
    names = [event.alarm for event in changed if event.alarm is not None]
    known: dict[str | None, EventRow] = {}
    for some in chunks(names):
        query = select(EventRow).where(EventRow.alarm.in_(some))
        known |= {row.alarm: row for row in session.scalars(query)}
    number = session.scalar(select(func.max(EventRow.number))) or 0
    for event in changed:
        row = None if event.alarm is None else known.get(event.alarm)
        if row is None:
            number += 1
            row = EventRow(number=number)
            session.add(row)
        for name, value in asdict(event).items():
            if name != "number":
                setattr(row, name, value)


def alarms(session: Session, ended_ns: int) -> Iterator[Event]:
    """Alarms in force and those that ended at ``ended_ns`` or later; oldest first."""
    lately = or_(EventRow.ended_ns.is_(None), EventRow.ended_ns >= ended_ns)
    query = select(EventRow).where(EventRow.alarm.is_not(None), lately)
    return map(_event, session.scalars(query.order_by(EventRow.number)))


def lasting(session: Session) -> Iterator[Event]:
    """What operators did, a pause above all, and alarms in force; oldest first."""
    query = select(EventRow).where(or_(EventRow.alarm.is_(None), EventRow.ended_ns.is_(None)))
    return map(_event, session.scalars(query.order_by(EventRow.number)))


def between(
    session: Session, begin_ns: int, end_ns: int, limit: int, before: int | None
) -> tuple[Event, ...]:
    """Events of a range of time, latest first."""
    query = select(EventRow).where(EventRow.time_ns >= begin_ns, EventRow.time_ns < end_ns)
    if before is not None:
        query = query.where(EventRow.number < before)
    return tuple(map(_event, session.scalars(query.order_by(EventRow.number.desc()).limit(limit))))


def last(session: Session, kinds: Collection[str]) -> Event | None:
    """The event of some kinds that was stored last; None: there is none."""
    query = select(EventRow).where(EventRow.kind.in_(kinds)).order_by(EventRow.number.desc())
    row = session.scalar(query.limit(1))
    return None if row is None else _event(row)


def delete_before(session: Session, before_ns: int, number: int) -> bool:
    """Delete some events of before a time, alarms in force not; False if there are none."""
    over = or_(EventRow.alarm.is_(None), EventRow.ended_ns.is_not(None))
    query = select(EventRow.number).where(EventRow.time_ns < before_ns, over)
    numbers = session.scalars(query.order_by(EventRow.time_ns).limit(number)).all()
    if numbers:
        session.execute(delete(EventRow).where(EventRow.number.in_(numbers)))
    return bool(numbers)


def _event(row: EventRow) -> Event:
    return Event(**{field.name: getattr(row, field.name) for field in fields(Event)})
