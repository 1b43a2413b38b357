"""The fleet at a moment of the kept past, and what became of it in a range of time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import case, func, select, tuple_
from sqlalchemy.orm import Session

from slipstream.messages import OrderState
from slipstream.orders import ENDED, IN_FORCE, OrderRecord, PlanRecord
from storage.models import CycleRow, OrderChangeRow, OrderRow, PlanRow
from storage.records.fleet import as_order, as_plan
from storage.records.sums import chunks

PLANS_LAST_S: Final = 48 * 3600.0
"""Plans of cycles that began longer before a moment are not looked for, s."""
ORDERS_LAST_S: Final = 7 * 86_400.0
"""An order whose last change lies longer before a moment counts only if it is still open now, s."""
ORDERS_LISTED_S: Final = 86_400.0
"""For so long an order that has ended is listed, s."""
SAVES_KWH: Final = 0.0005
"""What is saved less is shown as nothing, kWh."""
_OLDER_PLANS: Final = 3
"""Plans that a vehicle may have refused or left unanswered after the one that it follows."""
_NOT_FOLLOWED: Final = ("refused", "lapsed", "superseded")


@dataclass(frozen=True)
class OrderEnd:
    """How an order ended.

    Attributes:
        order: its id.
        state: served, failed or cancelled.
        time_ns: UTC.
        latest_ns: service was to begin no later, UTC; None: whenever.
    """

    order: str
    state: OrderState
    time_ns: int
    latest_ns: int | None


@dataclass(frozen=True)
class CycleSums:
    """The cycles of a range of time.

    Attributes:
        by_status: their number by status.
        wall_s: mean wall time, s; 0 if there is none.
        longest_s: the longest one.
        plans: that they sent.
        saving: those whose plans need less than the baseline, by `SAVES_KWH` at least.
    """

    by_status: Mapping[str, int]
    wall_s: float
    longest_s: float
    plans: int
    saving: int = 0


def span(session: Session) -> tuple[int, int] | None:
    """Begin of the first stored cycle, and of the last one or the last change of an order if that
    is later, UTC ns; None: there is no cycle.
    """
    first = session.scalar(select(func.min(CycleRow.started_ns)))
    last = session.scalar(select(func.max(CycleRow.started_ns)))
    if first is None or last is None:
        return None
    changed = session.scalar(select(func.max(OrderChangeRow.time_ns)))
    return first, max(last, changed or last)


def cycle_at(session: Session, time_ns: int) -> int | None:
    """Number of the last cycle that had begun at a moment; None: none had."""
    query = (
        select(CycleRow.cycle)
        .where(CycleRow.started_ns <= time_ns)
        .order_by(CycleRow.started_ns.desc())
        .limit(1)
    )
    return session.scalar(query)


def last_with_energy(session: Session, time_ns: int) -> CycleRow | None:
    """The last cycle at a moment whose plans drove at all; an idle one has no energy."""
    query = (
        select(CycleRow)
        .where(CycleRow.started_ns <= time_ns, CycleRow.baseline_kwh > 0)
        .order_by(CycleRow.started_ns.desc())
        .limit(1)
    )
    return session.scalar(query)


def plans_at(session: Session, time_ns: int) -> tuple[PlanRecord, ...]:
    """The plan that each vehicle had at a moment, by vehicle; where none was in force any more,
    its last one with what had become of it.
    """
    last = cycle_at(session, time_ns)
    first = session.scalar(
        select(func.min(CycleRow.cycle)).where(
            CycleRow.started_ns >= time_ns - round(PLANS_LAST_S * 1e9),
            CycleRow.started_ns <= time_ns,
        )
    )
    if last is None or first is None:
        return ()
    # Numbers and names alone are read from the key; a plan's row is large.
    within = (PlanRow.cycle >= first, PlanRow.cycle <= last)
    latest = (
        select(PlanRow.vehicle, func.max(PlanRow.cycle)).where(*within).group_by(PlanRow.vehicle)
    )
    found = {
        row.vehicle: _as_at(as_plan(row), time_ns)
        for row in _rows(session, [(cycle, vehicle) for vehicle, cycle in session.execute(latest)])
    }
    # It may have gone on by an older plan where it refused the last one, or did not answer it.
    refused = [name for name, record in found.items() if record.status in _NOT_FOLLOWED]
    older: dict[str, list[int]] = {}
    for some in chunks(refused):
        numbers = (
            select(PlanRow.vehicle, PlanRow.cycle)
            .where(*within, PlanRow.vehicle.in_(some))
            .order_by(PlanRow.cycle.desc())
        )
        for vehicle, cycle in session.execute(numbers):
            of_one = older.setdefault(vehicle, [])
            if cycle < found[vehicle].plan.cycle and len(of_one) < _OLDER_PLANS:
                of_one.append(cycle)
    keys = sorted((cycle, vehicle) for vehicle, cycles in older.items() for cycle in cycles)
    for row in _rows(session, keys):
        if not _had_ended(row, time_ns):
            found[row.vehicle] = _as_at(as_plan(row), time_ns)
    return tuple(record for _, record in sorted(found.items()))


def _rows(session: Session, keys: Sequence[tuple[int, str]]) -> Iterator[PlanRow]:
    """Plans by cycle and vehicle, in that order."""
    for some in chunks(sorted(keys)):
        yield from session.scalars(
            select(PlanRow)
            .where(tuple_(PlanRow.cycle, PlanRow.vehicle).in_(some))
            .order_by(PlanRow.cycle, PlanRow.vehicle)
        )


def _had_ended(row: PlanRow, time_ns: int) -> bool:
    return row.status not in IN_FORCE and row.status_ns <= time_ns


def _as_at(record: PlanRecord, time_ns: int) -> PlanRecord:
    if record.status in IN_FORCE or record.since_ns <= time_ns:
        return record
    # What became of it later was not known yet.
    return PlanRecord(record.plan, "published", record.plan.issued_ns, energy=record.energy)


def orders_at(session: Session, time_ns: int, limit: int) -> tuple[OrderRecord, ...]:
    """Orders at a moment that had not ended, or less than `ORDERS_LISTED_S` before.

    The newest ``limit`` ones, those that changed last at the end; `pinned` is not kept and None.
    """
    latest = (
        select(OrderChangeRow.order, func.max(OrderChangeRow.number).label("number"))
        .where(
            OrderChangeRow.time_ns <= time_ns,
            OrderChangeRow.time_ns > time_ns - round(ORDERS_LAST_S * 1e9),
        )
        .group_by(OrderChangeRow.order)
        .subquery()
    )
    changed = (
        select(OrderChangeRow, OrderRow)
        .join(
            latest,
            (OrderChangeRow.order == latest.c.order) & (OrderChangeRow.number == latest.c.number),
        )
        .join(OrderRow, OrderRow.order == OrderChangeRow.order)
        .where(
            OrderChangeRow.state.not_in(ENDED)
            | (OrderChangeRow.time_ns > time_ns - round(ORDERS_LISTED_S * 1e9))
        )
        .order_by(OrderChangeRow.time_ns.desc(), OrderChangeRow.order)
        .limit(limit)
    )
    found = {
        row.order: as_order(
            row,
            state=change.state,
            since_ns=change.time_ns,
            reason=change.reason,
            vehicle=change.vehicle,
            cycle=change.cycle,
            pinned=None,
        )
        for change, row in session.execute(changed)
    }
    unchanged = (
        select(OrderRow)
        .where(
            OrderRow.state.not_in(ENDED),
            OrderRow.since_ns <= time_ns - round(ORDERS_LAST_S * 1e9),
        )
        .order_by(OrderRow.since_ns.desc(), OrderRow.order)
        .limit(limit - len(found))
    )
    for row in session.scalars(unchanged):
        found.setdefault(row.order, as_order(row, pinned=None))
    return tuple(sorted(found.values(), key=lambda order: (order.since_ns, order.order)))


def order_ends(session: Session, begin_ns: int, end_ns: int) -> tuple[OrderEnd, ...]:
    """The orders that ended in a range of time, in its order."""
    query = (
        select(
            OrderChangeRow.order, OrderChangeRow.state, OrderChangeRow.time_ns, OrderRow.latest_ns
        )
        .join(OrderRow, OrderRow.order == OrderChangeRow.order)
        .where(
            OrderChangeRow.time_ns >= begin_ns,
            OrderChangeRow.time_ns < end_ns,
            OrderChangeRow.state.in_(ENDED),
        )
        .order_by(OrderChangeRow.time_ns)
    )
    rows: Any = session.execute(query)
    return tuple(OrderEnd(*row) for row in rows)


def cycle_sums(session: Session, begin_ns: int, end_ns: int) -> CycleSums:
    """What the cycles did that began in a range of time."""
    saved_kwh = CycleRow.baseline_kwh - CycleRow.cooperative_kwh
    query = (
        select(
            CycleRow.status,
            func.count(),
            func.sum(CycleRow.wall_s),
            func.max(CycleRow.wall_s),
            func.sum(CycleRow.plan_count),
            func.sum(case((saved_kwh >= SAVES_KWH, 1), else_=0)),
        )
        .where(CycleRow.started_ns >= begin_ns, CycleRow.started_ns < end_ns)
        .group_by(CycleRow.status)
    )
    rows = session.execute(query).all()
    number = sum(row[1] for row in rows)
    return CycleSums(
        {row[0]: row[1] for row in rows},
        sum(row[2] for row in rows) / number if number else 0.0,
        max((row[3] for row in rows), default=0.0),
        int(sum(row[4] for row in rows)),
        int(sum(row[5] for row in rows)),
    )
