"""Orders, plans in force and vehicles: stored with each cycle, loaded by a restarted dispatcher."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any, Final, cast

from sqlalchemy import Table, and_, delete, func, insert, or_, select, update
from sqlalchemy.orm import Session

from slipstream.messages import OrderState, PlanAcknowledgement, VehiclePosition
from slipstream.orders import (
    ENDED,
    IN_FORCE,
    FleetRecords,
    MovementSum,
    OrderChange,
    OrderRecord,
    PlanChange,
    PlanRecord,
    SpeedSum,
    VehicleRecord,
)
from storage.models import (
    MovementRow,
    OrderChangeRow,
    OrderRow,
    PlanChangeRow,
    PlanRow,
    SpeedRow,
    VehicleRow,
)
from storage.records import energy_ledger
from storage.records.sums import add_sums, chunks
from storage.rows import plan_energy, vehicle_plan

REMEMBERED_S: Final = 86_400.0
"""For so long a dispatcher knows an ended order that the fleet's file no longer has, s."""
LAPSED_S: Final = 3600.0
"""For so long a dispatcher knows a plan that lapsed: its vehicle may follow it all the same, s."""

ORDERS_A_STEP: Final = 500
"""Orders that are deleted in one transaction, at most."""


def save(session: Session, records: FleetRecords) -> None:
    """Store what has changed."""
    names = [order.order for order in records.orders]
    # Looked up together: `merge` would ask for each. They have to be held on to meanwhile.
    known = [row for some in chunks(names) for row in _rows(session, some)]
    for order in records.orders:
        session.merge(OrderRow(**asdict(order)))
    del known
    session.flush()
    if records.changes:
        session.execute(insert(OrderChangeRow), list(_numbered(session, records.changes)))
    for record in records.plans:
        session.execute(
            update(PlanRow)
            .where(PlanRow.cycle == record.plan.cycle, PlanRow.vehicle == record.plan.vehicle)
            .values(status=record.status, status_ns=record.since_ns, status_reason=record.reason)
        )
    if steps := list(_of_stored_plans(session, records.plan_changes)):
        session.execute(insert(PlanChangeRow), steps)
    energy_ledger.add(session, records.driven)
    for vehicle in records.vehicles:
        session.merge(VehicleRow(**_vehicle_values(vehicle)))
    add_sums(session, cast(Table, MovementRow.__table__), records.movements)
    add_sums(session, cast(Table, SpeedRow.__table__), records.speeds)


def add_orders(session: Session, records: FleetRecords) -> None:
    """Store orders that are not stored yet, with their first changes: nothing is looked up, as a
    caller waits. An id that is stored already is an IntegrityError.
    """
    session.execute(insert(OrderRow), [asdict(order) for order in records.orders])
    number: Counter[str] = Counter()
    rows = []
    for change in records.changes:
        rows.append({**asdict(change), "number": number[change.order]})
        number[change.order] += 1
    session.execute(insert(OrderChangeRow), rows)


def _rows(session: Session, names: Sequence[str]) -> Sequence[OrderRow]:
    return session.scalars(select(OrderRow).where(OrderRow.order.in_(names))).all()


def _numbered(session: Session, changes: Sequence[OrderChange]) -> Iterator[dict[str, object]]:
    """The rows of changes, numbered on from those stored."""
    number: dict[str, int] = defaultdict(int)
    for some in chunks(sorted({change.order for change in changes})):
        last = (
            select(OrderChangeRow.order, func.max(OrderChangeRow.number))
            .where(OrderChangeRow.order.in_(some))
            .group_by(OrderChangeRow.order)
        )
        number.update({order: highest + 1 for order, highest in session.execute(last)})
    for change in changes:
        yield {**asdict(change), "number": number[change.order]}
        number[change.order] += 1


def _of_stored_plans(
    session: Session, changes: Sequence[PlanChange]
) -> Iterator[dict[str, object]]:
    """The rows of changes, numbered on from those stored. A plan may have been deleted meanwhile,
    or be another database's: its changes are left out.
    """
    number: dict[tuple[int, str], int] = {}
    for cycles in chunks(sorted({change.cycle for change in changes})):
        last = (
            select(PlanRow.cycle, PlanRow.vehicle, func.max(PlanChangeRow.number))
            .outerjoin(
                PlanChangeRow,
                and_(
                    PlanChangeRow.cycle == PlanRow.cycle, PlanChangeRow.vehicle == PlanRow.vehicle
                ),
            )
            .where(PlanRow.cycle.in_(cycles))
            .group_by(PlanRow.cycle, PlanRow.vehicle)
        )
        for cycle, vehicle, highest in session.execute(last):
            number[cycle, vehicle] = 0 if highest is None else highest + 1
    for change in changes:
        plan = change.cycle, change.vehicle
        if plan in number:
            yield {**asdict(change), "number": number[plan]}
            number[plan] += 1


def load(session: Session, now_ns: int) -> FleetRecords:
    """What a dispatcher that starts has to know; see `REMEMBERED_S` and `LAPSED_S`."""
    recent = or_(
        OrderRow.state.not_in(ENDED),
        OrderRow.listed,
        OrderRow.since_ns >= now_ns - round(REMEMBERED_S * 1e9),
    )
    orders = session.scalars(select(OrderRow).where(recent).order_by(OrderRow.order))
    lapsed = and_(PlanRow.status == "lapsed", PlanRow.status_ns >= now_ns - round(LAPSED_S * 1e9))
    plans = session.scalars(
        select(PlanRow)
        .where(or_(PlanRow.status.in_(IN_FORCE), lapsed))
        .order_by(PlanRow.cycle, PlanRow.vehicle)
    )
    vehicles = session.scalars(select(VehicleRow).order_by(VehicleRow.vehicle))
    movements = select(MovementRow).order_by(
        MovementRow.segment, MovementRow.following, MovementRow.hour
    )
    return FleetRecords(
        orders=tuple(as_order(row) for row in orders),
        plans=tuple(as_plan(row) for row in plans),
        vehicles=tuple(_vehicle(row) for row in vehicles),
        movements=tuple(
            MovementSum(**_values(row, MovementSum)) for row in session.scalars(movements)
        ),
        speeds=tuple(
            SpeedSum(**_values(row, SpeedSum))
            for row in session.scalars(select(SpeedRow).order_by(SpeedRow.segment, SpeedRow.hour))
        ),
    )


def orders(
    session: Session, states: Collection[OrderState], ended_since_ns: int | None = None
) -> tuple[OrderRecord, ...]:
    """Orders in some states, but those that ended before; those that changed last at the end."""
    # Columns alone: a page reads a day's orders every few seconds.
    query = (
        select(*OrderRow.__table__.columns)
        .where(OrderRow.state.in_(states))
        .order_by(OrderRow.since_ns, OrderRow.order)
    )
    if ended_since_ns is not None:
        recent = OrderRow.since_ns >= ended_since_ns
        query = query.where(or_(OrderRow.state.not_in(ENDED), recent))
    return tuple(OrderRecord(**row._mapping) for row in session.execute(query))


def find(session: Session, names: Collection[str]) -> tuple[OrderRecord, ...]:
    """Those of some orders that are stored."""
    rows = (row for some in chunks(sorted(names)) for row in _rows(session, some))
    return tuple(map(as_order, rows))


def changes(session: Session, order: str) -> tuple[OrderChange, ...]:
    """The life of an order."""
    query = (
        select(OrderChangeRow).where(OrderChangeRow.order == order).order_by(OrderChangeRow.number)
    )
    return tuple(OrderChange(**_values(row, OrderChange)) for row in session.scalars(query))


def plans(session: Session, vehicle: str, limit: int, before: int | None) -> tuple[PlanRecord, ...]:
    """The last plans of a vehicle, of cycles before a number if one is given; latest first."""
    query = select(PlanRow).where(PlanRow.vehicle == vehicle)
    if before is not None:
        query = query.where(PlanRow.cycle < before)
    query = query.order_by(PlanRow.cycle.desc()).limit(limit)
    return tuple(map(as_plan, session.scalars(query)))


def plan_changes(session: Session, vehicle: str, cycles: Collection[int]) -> tuple[PlanChange, ...]:
    """Changes of the plans that some cycles made for a vehicle, by cycle, the first one first."""
    query = (
        select(PlanChangeRow)
        .where(PlanChangeRow.vehicle == vehicle, PlanChangeRow.cycle.in_(sorted(cycles)))
        .order_by(PlanChangeRow.cycle, PlanChangeRow.number)
    )
    return tuple(PlanChange(**_values(row, PlanChange)) for row in session.scalars(query))


def prune(session: Session, before_ns: int, number: int) -> bool:
    """Delete so many of the orders that ended before, if the fleet's file no longer has them: one
    that it has would be planned anew; False after the last ones.
    """
    query = select(OrderRow.order).where(
        OrderRow.state.in_(ENDED), ~OrderRow.listed, OrderRow.since_ns < before_ns
    )
    names = session.scalars(query.limit(number)).all()
    for some in chunks(names):
        session.execute(delete(OrderRow).where(OrderRow.order.in_(some)))
    return len(names) == number


def as_order(row: OrderRow, **changes: Any) -> OrderRecord:
    """Read an order back from its row, with some fields changed."""
    return OrderRecord(**(_values(row, OrderRecord) | changes))


def as_plan(row: PlanRow) -> PlanRecord:
    """Read a plan and what became of it back from its row."""
    status: Any = row.status
    return PlanRecord(vehicle_plan(row), status, row.status_ns, row.status_reason, plan_energy(row))


def _vehicle(row: VehicleRow) -> VehicleRecord:
    values = _values(row, VehicleRecord)
    position = values["position"]
    if position is not None:
        values["position"] = VehiclePosition.model_validate(position, strict=False)
    if values["answer"] is not None:
        values["answer"] = PlanAcknowledgement.model_validate(values["answer"])
    return VehicleRecord(**values)


def _vehicle_values(record: VehicleRecord) -> Mapping[str, Any]:
    values = {field.name: getattr(record, field.name) for field in fields(VehicleRecord)}
    if record.position is not None:
        values["position"] = record.position.model_dump(mode="json")
    if record.answer is not None:
        values["answer"] = record.answer.model_dump(mode="json")
    return values


def _values(row: object, record: type[Any]) -> dict[str, Any]:
    return {field.name: getattr(row, field.name) for field in fields(record)}
