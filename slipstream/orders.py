"""What is recorded of orders, plans and vehicles: the life of each, with times and reasons; and of
movements, what they cost.

An order is open, planned (a published plan has it), under_way (its vehicle has left with it), and
served, failed or cancelled in the end. A plan is published, acknowledged by its vehicle, and in the
end refused by it, superseded by a later one, done, or lapsed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, Literal, get_args

from slipstream.energy.ledger import EnergyHour, PlanEnergy
from slipstream.messages import (
    OrderRefusal,
    OrderState,
    PlanAcknowledgement,
    RefusalKind,
    VehiclePlan,
    VehiclePosition,
)

ORDER_STATES: Final[tuple[OrderState, ...]] = get_args(OrderState)
ENDED: Final[frozenset[OrderState]] = frozenset({"served", "failed", "cancelled"})

PlanStatus = Literal["published", "acknowledged", "refused", "superseded", "done", "lapsed"]
IN_FORCE: Final[frozenset[PlanStatus]] = frozenset({"published", "acknowledged"})


@dataclass(frozen=True)
class OrderRecord:
    """One order as it is now.

    Attributes:
        order: its id, the stop's.
        node: junction of the stop.
        service_s: time at the stop.
        demand: of a vehicle's capacity.
        earliest_ns: service starts no sooner, UTC; None: whenever, or an open one of the file.
        latest_ns: service starts no later, UTC; None: likewise.
        state: see the module.
        since_ns: UTC of the last change of state, vehicle or plan.
        reason: of that change.
        vehicle: that has it; None: none. It stays when the order has ended.
        cycle: of that vehicle's plan.
        listed: whether somebody asks for it: the fleet's file has it, or its caller has not
            cancelled it and it has not ended.
        request: of a caller, as JSON of an `OrderRequest`; None: it is the file's.
        received_ns: UTC of that request.
        pinned: only this vehicle may serve it; None: any.
    """

    order: str
    node: str
    service_s: float
    demand: int
    earliest_ns: int | None
    latest_ns: int | None
    state: OrderState
    since_ns: int
    reason: str
    vehicle: str | None = None
    cycle: int | None = None
    listed: bool = True
    request: dict[str, Any] | None = None
    received_ns: int | None = None
    pinned: str | None = None

    @property
    def source(self) -> Literal["file", "api"]:
        """Who asks for it: the fleet's file, or a caller."""
        return "file" if self.request is None else "api"

    @property
    def ended(self) -> bool:
        """True if nothing more is to be done for it."""
        return self.state in ENDED


@dataclass(frozen=True)
class OrderChange:
    """One change in an order's life; fields as in `OrderRecord`."""

    order: str
    time_ns: int
    state: OrderState
    reason: str
    vehicle: str | None
    cycle: int | None


@dataclass(frozen=True)
class PlanRecord:
    """What became of one vehicle's plan.

    Attributes:
        plan: as it was published.
        status: see the module.
        since_ns: UTC of the last change.
        reason: why it was refused, superseded or has lapsed; None otherwise.
        energy: of it; None: not known, and nothing is booked of it.
    """

    plan: VehiclePlan
    status: PlanStatus
    since_ns: int
    reason: str | None = None
    energy: PlanEnergy | None = None


@dataclass(frozen=True)
class PlanChange:
    """One change of a plan's status; fields as in `PlanRecord`, the plan by cycle and vehicle."""

    cycle: int
    vehicle: str
    time_ns: int
    status: PlanStatus
    reason: str | None


def drafting_kwh(records: Iterable[PlanRecord]) -> dict[tuple[str, int], float]:
    """What platoons save of plans, by vehicle and cycle, of those whose energy is known."""
    return {
        (record.plan.vehicle, record.plan.cycle): record.energy.drafting_kwh
        for record in records
        if record.energy is not None
    }


@dataclass(frozen=True)
class VehicleRecord:
    """What is known of a vehicle that has reported at least once, or has a plan.

    Attributes:
        vehicle: its id.
        definition: as in the fleet's file.
        depot: likewise.
        position: the latest; None: it has never sent one.
        reports_progress: whether it has ever sent its visits.
        answered_ns: UTC of its last message of any kind; None: it has never sent one.
        left_out_until: cycle from which on it is planned again after a refusal; 0: it is.
        booked: up to where the plan that it has acknowledged is in the energy ledger, in segments
            of its way; see `slipstream.energy.ledger`.
        rested_ns: when its last break ended, UTC; 0: it has had none.
        rested_break: number of that break among its own, from 0; None: not known.
        answer: its latest answer to a plan; None: it has sent none.
    """

    vehicle: str
    definition: dict[str, Any]
    depot: dict[str, Any]
    position: VehiclePosition | None = None
    reports_progress: bool = False
    answered_ns: int | None = None
    left_out_until: int = 0
    booked: float = 0.0
    rested_ns: int = 0
    rested_break: int | None = None
    answer: PlanAcknowledgement | None = None


@dataclass(frozen=True)
class MovementSum:
    """Sums over passages of a segment and the turn behind it, in one hour of the day.

    Attributes:
        segment: driven.
        following: next segment.
        hour: of the day, UTC.
        count: passages.
        loss_kwh: see `dispatcher_daemon.traffic.snapshot.Expectations`.
        seconds: likewise.
        stops: times that vehicles came to a stand.
    """

    segment: str
    following: str
    hour: int
    count: float
    loss_kwh: float
    seconds: float
    stops: float


@dataclass(frozen=True)
class SpeedSum:
    """Sums over what RSUs have measured on a segment in one hour of the day.

    Attributes:
        segment: watched.
        hour: of the day, UTC.
        count: mean speeds, one a cycle.
        speed_mps: their sum.
        states: fresh states, with or without a mean speed, one a cycle.
        calm: those with y_e = 1.
    """

    segment: str
    hour: int
    count: float
    speed_mps: float
    states: float = 0.0
    calm: float = 0.0


@dataclass(frozen=True)
class FleetRecords:
    """What a cycle stores of orders, plans and vehicles, or a start loads of them.

    Attributes:
        orders: that have changed, or all that count.
        changes: in their order; none when loaded.
        plans: of earlier cycles whose status has changed, or all in force and lately lapsed.
        vehicles: that have changed, or all.
        movements: what is to be added to their sums, or the sums.
        speeds: likewise.
        driven: what is to be added to the energy ledger; none when loaded.
        plan_changes: of plans' statuses, in their order; none when loaded.
    """

    orders: tuple[OrderRecord, ...] = ()
    changes: tuple[OrderChange, ...] = ()
    plans: tuple[PlanRecord, ...] = ()
    vehicles: tuple[VehicleRecord, ...] = ()
    movements: tuple[MovementSum, ...] = ()
    speeds: tuple[SpeedSum, ...] = ()
    driven: tuple[EnergyHour, ...] = ()
    plan_changes: tuple[PlanChange, ...] = ()


class OrderRefused(Exception):
    """A request that nothing was done for."""

    def __init__(
        self,
        kind: RefusalKind,
        problem: str,
        mend: str,
        *,
        order: str | None = None,
        key: str | None = None,
    ) -> None:
        self.refusal = OrderRefusal(order=order, kind=kind, key=key, problem=problem, mend=mend)
        super().__init__(f"{order or 'order'}: {problem}; {mend}")


def with_reason(text: str, reason: str | None) -> str:
    """What was done, with why somebody says that they did it."""
    return f"{text}: {reason}" if reason else text


def utc(time_ns: int) -> str:
    """A moment for people, as reasons name it."""
    return datetime.fromtimestamp(time_ns // 10**9, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
