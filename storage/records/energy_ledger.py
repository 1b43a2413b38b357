"""The table of what was driven by the plans in force: added to by hour, summed, deleted by age."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final, Literal

from sqlalchemy import BigInteger, Column, Double, String, Table, delete, func, literal, select
from sqlalchemy.orm import Session

from slipstream.energy.ledger import FIGURES, HOUR_NS, EnergyHour, EnergySum, merged
from storage.models import Base
from storage.records.sums import add_sums

SumBy = Literal["hour", "day", "all"]
DAY_NS: Final = 24 * HOUR_NS
ROWS_A_STEP: Final = 1000
"""Rows that are deleted in one transaction, about, at most."""

# Ordered by time first, as roll-ups are.
energy_ledger: Final = Table(
    "energy_ledger",
    Base.metadata,
    Column("hour_ns", BigInteger, primary_key=True, autoincrement=False),
    Column("vehicle", String, primary_key=True),
    *(Column(name, Double, nullable=False) for name in FIGURES),
    sqlite_with_rowid=False,
)
"""What a vehicle has driven in an hour (a `slipstream.energy.ledger.EnergyHour`)."""
_T: Final = energy_ledger.c


def add(session: Session, parts: Iterable[EnergyHour]) -> None:
    """Add parts to the rows of their hours and vehicles; the first one makes the row."""
    add_sums(session, energy_ledger, merged(parts))


def hours(
    session: Session, begin_ns: int, end_ns: int, vehicle: str | None
) -> Iterator[EnergyHour]:
    """Rows whose hours begin in a range of time, by hour and vehicle."""
    query = select(energy_ledger).where(_T.hour_ns >= begin_ns, _T.hour_ns < end_ns)
    if vehicle is not None:
        query = query.where(_T.vehicle == vehicle)
    for row in session.execute(query.order_by(_T.hour_ns, _T.vehicle)):
        yield EnergyHour(*row)


def sums(
    session: Session, begin_ns: int, end_ns: int, by: SumBy, vehicle: str | None = None
) -> Iterator[EnergySum]:
    """Sums over all vehicles, or of one, oldest first; those of periods in which nothing was driven
    are missing.
    """
    within = [_T.hour_ns >= begin_ns, _T.hour_ns < end_ns]
    if vehicle is not None:
        within.append(_T.vehicle == vehicle)
    figures = [func.sum(_T[name]) for name in FIGURES]
    if by == "all":
        query = select(literal(begin_ns, BigInteger), *figures).where(*within)
        yield from (EnergySum(*row) for row in session.execute(query) if row[1] is not None)
        return
    period = _T.hour_ns if by == "hour" else _T.hour_ns - _T.hour_ns % DAY_NS
    for row in session.execute(
        select(period, *figures).where(*within).group_by(period).order_by(period)
    ):
        yield EnergySum(*row)


def delete_oldest(session: Session, before_ns: int, rows: int) -> bool:
    """Delete the rows of the oldest hours that ended before; False if there are none.

    Some ``rows``, and one hour at least.
    """
    oldest = select(_T.hour_ns).where(_T.hour_ns + HOUR_NS <= before_ns)
    upto_ns = session.scalars(oldest.order_by(_T.hour_ns).limit(rows)).all()
    if not upto_ns:
        return False
    session.execute(delete(energy_ledger).where(_T.hour_ns <= upto_ns[-1]))
    return True
