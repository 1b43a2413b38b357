"""The tables: cycles with their solver runs, plans and inputs; orders, vehicles; events; jobs; the
clock. Those of traffic are in `storage.traffic.models`.

Times are UTC nanoseconds. Parts that are only read together with their row (a plan's stops and
segments, a cycle's unserved stops) are JSON as in `slipstream.messages`.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    MetaData,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

# Named constraints, so that later migrations can drop or alter them on every database.
NAMING = {
    "ix": "ix_%(column_0_label)s",
    "uq": "uq_%(table_name)s_%(column_0_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}


class Base(DeclarativeBase):
    """Base of all tables."""

    metadata = MetaData(naming_convention=NAMING)
    type_annotation_map = {  # noqa: RUF012
        int: BigInteger,
        float: Double,
        dict[str, Any]: JSON,
        list[Any]: JSON,
    }


def _cycle_key() -> Mapped[int]:
    return mapped_column(ForeignKey("cycles.cycle", ondelete="CASCADE"), primary_key=True)


class CycleRow(Base):
    """One dispatch cycle: the scalar fields of a CycleReport and of its EnergySummary."""

    __tablename__ = "cycles"

    cycle: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    started_ns: Mapped[int] = mapped_column(index=True)
    wall_s: Mapped[float]
    status: Mapped[str]
    reason: Mapped[str | None]
    solver: Mapped[str | None]
    objective_kwh: Mapped[float | None]
    variables: Mapped[int]
    plan_count: Mapped[int]
    baseline: Mapped[str | None]
    baseline_kwh: Mapped[float | None]
    cooperative_kwh: Mapped[float | None]
    saved_distance_kwh: Mapped[float | None]
    saved_drag_kwh: Mapped[float | None]
    saved_acceleration_kwh: Mapped[float | None]
    platooned_distance_m: Mapped[float | None]
    baseline_driving_s: Mapped[float | None]
    cooperative_driving_s: Mapped[float | None]
    price_of_time_kw: Mapped[float | None]
    unserved: Mapped[list[Any]]
    carriers: Mapped[list[Any]]

    solver_runs: Mapped[list[SolverRunRow]] = relationship(
        cascade="all, delete-orphan", order_by="SolverRunRow.position", passive_deletes=True
    )
    plans: Mapped[list[PlanRow]] = relationship(
        cascade="all, delete-orphan", order_by="PlanRow.vehicle", passive_deletes=True
    )


class SolverRunRow(Base):
    """One solver's result in one cycle (a SolverReport)."""

    __tablename__ = "solver_runs"

    cycle: Mapped[int] = _cycle_key()
    position: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    solver: Mapped[str]
    status: Mapped[str]
    objective_kwh: Mapped[float | None]
    repaired: Mapped[bool]
    p_feasible_raw: Mapped[float | None]
    p_optimal_raw: Mapped[float | None]
    p_feasible_repaired: Mapped[float | None]
    qubits: Mapped[int | None]
    shots: Mapped[int | None]
    wall_s: Mapped[float]
    reason: Mapped[str | None]
    backend: Mapped[str | None]
    backend_kind: Mapped[str | None]
    fallback: Mapped[str | None]
    two_qubit_depth: Mapped[int | None]


class PlanRow(Base):
    """One vehicle's plan from one cycle (a VehiclePlan), and what became of it (a PlanRecord)."""

    __tablename__ = "plans"

    cycle: Mapped[int] = _cycle_key()
    vehicle: Mapped[str] = mapped_column(primary_key=True)
    issued_ns: Mapped[int]
    valid_until_ns: Mapped[int]
    depart_ns: Mapped[int]
    distance_m: Mapped[float]
    energy_kwh: Mapped[float]
    stops: Mapped[list[Any]]
    segments: Mapped[list[Any]]
    advice: Mapped[dict[str, Any]]
    continues: Mapped[int | None]
    status: Mapped[str] = mapped_column(index=True)
    status_ns: Mapped[int]
    status_reason: Mapped[str | None]
    segment_energy: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))


class PlanChangeRow(Base):
    """One change of a plan's status (a `slipstream.orders.PlanChange`), numbered from 0."""

    __tablename__ = "plan_changes"
    __table_args__ = (
        ForeignKeyConstraint(
            ["cycle", "vehicle"], ["plans.cycle", "plans.vehicle"], ondelete="CASCADE"
        ),
    )

    cycle: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    vehicle: Mapped[str] = mapped_column(primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    time_ns: Mapped[int]
    status: Mapped[str]
    reason: Mapped[str | None]


class InputPartRow(Base):
    """A part of cycles' inputs, compressed, once for all that have it (a `storage.Part`)."""

    __tablename__ = "input_parts"

    hash: Mapped[str] = mapped_column(primary_key=True)
    data: Mapped[bytes]


class InputRow(Base):
    """What a cycle alone was made from, and what it recorded, compressed; see `records.inputs`."""

    __tablename__ = "cycle_inputs"

    cycle: Mapped[int] = _cycle_key()
    data: Mapped[bytes]


class InputUseRow(Base):
    """A part that a cycle's inputs have, by its name there."""

    __tablename__ = "input_uses"

    cycle: Mapped[int] = mapped_column(
        ForeignKey("cycle_inputs.cycle", ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(primary_key=True)
    hash: Mapped[str] = mapped_column(ForeignKey("input_parts.hash"), index=True)


class OrderRow(Base):
    """An order as it is now (a `slipstream.orders.OrderRecord`)."""

    __tablename__ = "orders"

    order: Mapped[str] = mapped_column(primary_key=True)
    node: Mapped[str]
    service_s: Mapped[float]
    demand: Mapped[int]
    earliest_ns: Mapped[int | None]
    latest_ns: Mapped[int | None]
    state: Mapped[str] = mapped_column(index=True)
    since_ns: Mapped[int]
    reason: Mapped[str]
    vehicle: Mapped[str | None]
    cycle: Mapped[int | None]
    listed: Mapped[bool]
    request: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    received_ns: Mapped[int | None]
    pinned: Mapped[str | None]


class OrderChangeRow(Base):
    """One change in an order's life (a `slipstream.orders.OrderChange`), numbered from 0."""

    __tablename__ = "order_changes"

    order: Mapped[str] = mapped_column(
        ForeignKey("orders.order", ondelete="CASCADE"), primary_key=True
    )
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    time_ns: Mapped[int] = mapped_column(index=True)
    state: Mapped[str]
    reason: Mapped[str]
    vehicle: Mapped[str | None]
    cycle: Mapped[int | None]


class VehicleRow(Base):
    """A vehicle and its last report (a `slipstream.orders.VehicleRecord`)."""

    __tablename__ = "vehicles"

    vehicle: Mapped[str] = mapped_column(primary_key=True)
    definition: Mapped[dict[str, Any]]
    depot: Mapped[dict[str, Any]]
    position: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    reports_progress: Mapped[bool]
    answered_ns: Mapped[int | None]
    left_out_until: Mapped[int]
    booked: Mapped[float]
    rested_ns: Mapped[int]
    rested_break: Mapped[int | None]
    answer: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))


class MovementRow(Base):
    """Passages of a movement in one hour of the day (a `slipstream.orders.MovementSum`)."""

    __tablename__ = "movements"

    segment: Mapped[str] = mapped_column(primary_key=True)
    following: Mapped[str] = mapped_column(primary_key=True)
    hour: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    count: Mapped[float]
    loss_kwh: Mapped[float]
    seconds: Mapped[float]
    stops: Mapped[float]


class SpeedRow(Base):
    """What was measured on a segment in one hour of the day (a `slipstream.orders.SpeedSum`)."""

    __tablename__ = "speeds"

    segment: Mapped[str] = mapped_column(primary_key=True)
    hour: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    count: Mapped[float]
    speed_mps: Mapped[float]
    states: Mapped[float]
    calm: Mapped[float]


class EventRow(Base):
    """Something that operators are told of (a `storage.Event`)."""

    __tablename__ = "events"

    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    time_ns: Mapped[int] = mapped_column(index=True)
    kind: Mapped[str]
    severity: Mapped[str]
    subject: Mapped[str]
    text: Mapped[str]
    mend: Mapped[str | None]
    actor: Mapped[str | None]
    alarm: Mapped[str | None] = mapped_column(index=True)
    ended_ns: Mapped[int | None]
    acknowledged_by: Mapped[str | None]
    acknowledged_ns: Mapped[int | None]


class ClockRow(Base):
    """The one row of the time up to which the dispatcher's clock was to be trusted, UTC ns."""

    __tablename__ = "clock"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    trusted_ns: Mapped[int]


class QuantumJobRow(Base):
    """One job of a quantum device (a `storage.QuantumJob`)."""

    __tablename__ = "quantum_jobs"

    tag: Mapped[str] = mapped_column(primary_key=True)
    job_id: Mapped[str | None]
    backend: Mapped[str]
    kind: Mapped[str]
    cycle: Mapped[int]
    submitted_ns: Mapped[int] = mapped_column(index=True)
    updated_ns: Mapped[int]
    finished_ns: Mapped[int | None]
    state: Mapped[str]
    reason: Mapped[str | None]
    estimate_s: Mapped[float]
    usage_s: Mapped[float | None]
    shots: Mapped[int]
    circuit: Mapped[str]
    variables: Mapped[str]
    chain_order: Mapped[list[Any]]
    variant: Mapped[str]
    layers: Mapped[int]
    two_qubit_depth: Mapped[int | None]
    two_qubit_gates: Mapped[int | None]
    train_s: Mapped[float]
    answer: Mapped[str | None]
    answer_cycle: Mapped[int | None]
