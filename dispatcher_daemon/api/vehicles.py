"""Vehicles as they are now, and their plans: the present one and those before."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, Field

from dispatcher_daemon.api.auth import requires
from dispatcher_daemon.api.parameters import After, Before, Limit, Name
from dispatcher_daemon.api.problems import Problem
from dispatcher_daemon.api.services import Dispatch
from dispatcher_daemon.tracking import TrackedVehicle
from slipstream.messages import TimeNs, VehiclePlan, VehiclePosition
from slipstream.orders import PlanRecord, PlanStatus

router = APIRouter(prefix="/v1", tags=["vehicles"], dependencies=[requires("read")])


class PlanSummary(BaseModel):
    """Which plan, and what became of it."""

    cycle: int
    status: PlanStatus = Field(description="acknowledged: the vehicle follows it.")
    since_ns: TimeNs
    reason: str | None = Field(description="Why it was refused, superseded or has lapsed.")


class VehicleStatus(BaseModel):
    """One vehicle as the dispatcher knows it."""

    id: str
    listed: bool = Field(description="Whether the fleet file has it now.")
    reports: bool = Field(description="Whether it has ever sent a message.")
    silent: bool = Field(description="It has sent messages before, and sends none now.")
    position: VehiclePosition | None = Field(description="The latest; null: it has sent none.")
    accepted: PlanSummary | None = Field(description="The plan that it has acknowledged.")
    offered: PlanSummary | None = Field(description="The plan that it has not answered yet.")


class VehiclePage(BaseModel):
    """Vehicles by id."""

    time_ns: TimeNs = Field(description="When it was so.")
    vehicles: list[VehicleStatus]
    next: str | None = Field(description="`after` of the next page; null: there is none.")


class PlanState(PlanSummary):
    """A plan, and what became of it."""

    plan: VehiclePlan


class PlanPage(BaseModel):
    """A vehicle's plans."""

    vehicle: str
    accepted: PlanState | None = Field(description="The plan that it has acknowledged.")
    offered: PlanState | None = Field(description="The plan that it has not answered yet.")
    history: list[PlanState] = Field(description="All its plans, latest first.")
    next: int | None = Field(description="`before` of the next page; null: there is none.")


@router.get("/vehicles")
def list_vehicles(dispatch: Dispatch, limit: Limit = 100, after: After = None) -> VehiclePage:
    """Vehicles of the fleet file, and those that it had before, with position and plan."""
    copy = dispatch.fleet.vehicles()
    names = [name for name in copy.vehicles if after is None or name > after]
    page = [_status(copy.vehicles[name], copy.time_ns) for name in names[:limit]]
    following = names[limit - 1] if len(names) > limit else None
    return VehiclePage(time_ns=copy.time_ns, vehicles=page, next=following)


@router.get("/vehicles/{vehicle:path}")
def get_vehicle(dispatch: Dispatch, vehicle: Name) -> VehicleStatus:
    """One vehicle."""
    copy = dispatch.fleet.vehicles()
    return _status(_known(copy.vehicles.get(vehicle), vehicle), copy.time_ns)


@router.get("/plans/{vehicle:path}")
def get_plans(
    dispatch: Dispatch, vehicle: Name, limit: Limit = 10, before: Before = None
) -> PlanPage:
    """A vehicle's present plan and the database's history of its plans."""
    tracked = _known(dispatch.fleet.vehicles().vehicles.get(vehicle), vehicle)
    history = dispatch.reader.plans_of(vehicle, limit + 1, before)
    return PlanPage(
        vehicle=vehicle,
        accepted=_state(tracked.accepted),
        offered=_state(tracked.offered),
        history=[_shown(record) for record in history[:limit]],
        next=history[limit - 1].plan.cycle if len(history) > limit else None,
    )


def _known(vehicle: TrackedVehicle | None, name: str) -> TrackedVehicle:
    if vehicle is None:
        mend = "take an id that GET /v1/vehicles lists"
        raise Problem(404, f"no vehicle {name!r}", mend, field="vehicle")
    return vehicle


def _status(vehicle: TrackedVehicle, now_ns: int) -> VehicleStatus:
    return VehicleStatus(
        id=vehicle.id,
        listed=vehicle.listed,
        reports=vehicle.has_telemetry,
        silent=vehicle.has_telemetry and not vehicle.is_fresh(now_ns),
        position=vehicle.position,
        accepted=_summary(vehicle.accepted),
        offered=_summary(vehicle.offered),
    )


def _summary(record: PlanRecord | None) -> PlanSummary | None:
    if record is None:
        return None
    return PlanSummary(
        cycle=record.plan.cycle,
        status=record.status,
        since_ns=record.since_ns,
        reason=record.reason,
    )


def _state(record: PlanRecord | None) -> PlanState | None:
    return None if record is None else _shown(record)


def _shown(record: PlanRecord) -> PlanState:
    return PlanState(
        cycle=record.plan.cycle,
        status=record.status,
        since_ns=record.since_ns,
        reason=record.reason,
        plan=record.plan,
    )
