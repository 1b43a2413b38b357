"""Vehicles: what each is and where, what it reports over HTTP; its plans, now and before."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.tracking import FleetTracker, TrackedVehicle
from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.body import SOURCE, body_of, describe_body
from dispatcher_daemon.service.api.parameters import After, Before, Limit, Name
from dispatcher_daemon.service.api.services import Dispatch, Services
from dispatcher_daemon.service.fleet_watch import VehicleReport
from slipstream.errors import InputError
from slipstream.http.problems import Problem
from slipstream.messages import (
    PlanAcknowledgement,
    TimeNs,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
)
from slipstream.orders import PlanChange, PlanRecord, PlanStatus
from slipstream.vehicle_types import VehicleType

router = APIRouter(prefix="/v1", tags=["vehicles"])
_READ = [requires("read")]
_REPORT = [requires("vehicles")]
_PATH = "/vehicles/{vehicle:path}"


class DepotPlace(BaseModel):
    """Where a vehicle starts and ends."""

    id: str
    node: str = Field(description="Junction of the road network.")


class Shift(BaseModel):
    """When a vehicle works, as the fleet's file says it: by the clock, such as "07:00" of each day
    or with a date, or in seconds after the moment that a cycle's plans count from.
    """

    ready: str | None = Field(description="Leaves no sooner; null: `ready_s` says when.")
    ready_s: float | None
    depart_by: str | None = Field(description="Leaves no later.")
    depart_by_s: float | None = Field(description="Both null: it leaves when it is ready.")
    return_by: str | None = Field(description="Is back by then.")
    return_by_s: float | None = Field(description="Both null: whenever.")


class BreakTimes(BaseModel):
    """A break and its window, the times as in `Shift`."""

    duration_s: float
    earliest: str | None = Field(description="Begins no sooner; null: `earliest_s` says when.")
    earliest_s: float | None
    latest: str | None = Field(description="Begins no later; null: `latest_s` says when.")
    latest_s: float | None


class PlanSummary(BaseModel):
    """Which plan, and what became of it."""

    cycle: int
    status: PlanStatus = Field(description="acknowledged: the vehicle follows it.")
    since_ns: TimeNs
    reason: str | None = Field(description="Why it was refused, superseded or has lapsed.")


class VehicleStatus(BaseModel):
    """One vehicle as the dispatcher knows it. What the fleet's file says is as it was when the last
    cycle began; of a vehicle that it no longer lists, as it was there last.
    """

    id: str
    depot: DepotPlace
    carrier: str | None = Field(description="Who runs it; null: none is named.")
    type: str | None = Field(
        description="A preset or a type of the fleet's file; null: `type_data` alone, if given."
    )
    type_data: VehicleType | None = Field(
        description="Of the type, or its own; null: the paper's car, or a type that the file has "
        "no more."
    )
    capacity: int | None = Field(description="Total demand that it can carry; null: any.")
    skills: tuple[str, ...]
    first_stop: str | None = Field(description="Its load, which it drives to first; null: none.")
    time_zone: str | None = Field(description="Of clock times; null: no fleet is listed now.")
    shift: Shift
    breaks: tuple[BreakTimes, ...] = Field(description="In the order in which they are taken.")
    listed: bool = Field(description="Whether the fleet file has it now.")
    reports: bool = Field(description="Whether it has ever sent a message.")
    silent: bool = Field(description="It has sent messages before, and sends none now.")
    heard_ns: TimeNs | None = Field(
        description="When its last message came, UTC; null: it was never heard."
    )
    orders: int = Field(description="Orders that it has by its plan, or has left with.")
    position: VehiclePosition | None = Field(
        description="The latest, also of one that is silent; null: it has sent none."
    )
    accepted: PlanSummary | None = Field(description="The plan that it has acknowledged.")
    offered: PlanSummary | None = Field(description="The plan that it has not answered yet.")
    answer: PlanAcknowledgement | None = Field(
        description="Its latest answer to a plan: which one, when by its own clock, and why it "
        "refused; null: it has sent none."
    )


class VehiclePage(BaseModel):
    """Vehicles by id."""

    time_ns: TimeNs = Field(description="When it was so.")
    vehicles: list[VehicleStatus]
    next: str | None = Field(description="`after` of the next page; null: there is none.")


class PlanStep(BaseModel):
    """A change of a plan's status."""

    time_ns: TimeNs
    status: PlanStatus = Field(description="published: it was sent.")
    reason: str | None


class PlanState(PlanSummary):
    """A plan, and what became of it."""

    plan: VehiclePlan
    history: list[PlanStep] = Field(description="Its changes, the first one first.")


class PlanPage(BaseModel):
    """A vehicle's plans."""

    vehicle: str
    accepted: PlanState | None = Field(description="The plan that it has acknowledged.")
    offered: PlanState | None = Field(description="The plan that it has not answered yet.")
    history: list[PlanState] = Field(description="All its plans, latest first.")
    next: int | None = Field(description="`before` of the next page; null: there is none.")


@router.get("/vehicles", dependencies=_READ)
def list_vehicles(dispatch: Dispatch, limit: Limit = 100, after: After = None) -> VehiclePage:
    """Vehicles of the fleet file, and those that it had before, with position and plan."""
    copy = dispatch.fleet.vehicles()
    names = [name for name in copy.vehicles if after is None or name > after]
    fleet = dispatch.fleet.fleet
    page = [
        _status(copy.vehicles[name], copy.orders.get(name, 0), fleet, copy.time_ns)
        for name in names[:limit]
    ]
    following = names[limit - 1] if len(names) > limit else None
    return VehiclePage(time_ns=copy.time_ns, vehicles=page, next=following)


@router.get(_PATH, dependencies=_READ)
def get_vehicle(dispatch: Dispatch, vehicle: Name) -> VehicleStatus:
    """One vehicle."""
    copy = dispatch.fleet.vehicles()
    known = _known(copy.vehicles.get(vehicle), vehicle)
    orders = copy.orders.get(vehicle, 0)
    return _status(known, orders, dispatch.fleet.fleet, copy.time_ns)


@router.post(
    _PATH + "/position", dependencies=_REPORT, openapi_extra=describe_body(VehiclePosition)
)
def report_position(
    dispatch: Dispatch,
    vehicle: Name,
    report: Annotated[VehiclePosition, body_of(VehiclePosition, "leg")],
) -> VehicleStatus:
    """Take what a vehicle without a bus says of its place, as one on the bus says it each second.
    One that is dated no later than the last one changes nothing.
    """
    return _taken(dispatch, vehicle, report)


@router.post(
    _PATH + "/acknowledgement",
    dependencies=_REPORT,
    openapi_extra=describe_body(PlanAcknowledgement),
)
def report_acknowledgement(
    dispatch: Dispatch,
    vehicle: Name,
    report: Annotated[PlanAcknowledgement, body_of(PlanAcknowledgement, "reason")],
) -> VehicleStatus:
    """Take a vehicle's answer to its plan: accepted, or refused with a reason. An answer to a plan
    that is not in force any more changes nothing.
    """
    return _taken(dispatch, vehicle, report)


@router.post(
    _PATH + "/progress", dependencies=_REPORT, openapi_extra=describe_body(VehicleProgress)
)
def report_progress(
    dispatch: Dispatch, vehicle: Name, report: Annotated[VehicleProgress, body_of(VehicleProgress)]
) -> VehicleStatus:
    """Take a vehicle's visits to the stops of its last tours: arrived, served or failed. Each
    report repeats them; one whose `cycle` is null says that the tour has ended.
    """
    return _taken(dispatch, vehicle, report)


@router.get("/plans/{vehicle:path}", dependencies=_READ)
def get_plans(
    dispatch: Dispatch, vehicle: Name, limit: Limit = 10, before: Before = None
) -> PlanPage:
    """A vehicle's present plan and the database's history of its plans."""
    copy = dispatch.fleet.vehicles()
    tracked = _known(copy.vehicles.get(vehicle), vehicle)
    found = dispatch.reader.plans_of(vehicle, limit + 1, before)
    page = found[:limit]
    present = [record for record in (tracked.accepted, tracked.offered) if record is not None]
    cycles = {record.plan.cycle for record in (*page, *present)}
    stored = dispatch.reader.plan_changes(vehicle, cycles)
    pending = (change for change in copy.plan_changes if change.vehicle == vehicle)
    steps = _steps(stored, pending)
    return PlanPage(
        vehicle=vehicle,
        accepted=_state(tracked.accepted, steps),
        offered=_state(tracked.offered, steps),
        history=[_shown(_as_of_now(record, steps), steps) for record in page],
        next=page[-1].plan.cycle if len(found) > limit else None,
    )


def _taken(dispatch: Services, vehicle: str, report: VehicleReport) -> VehicleStatus:
    """What a report is answered with: its vehicle, with the plans that it has now."""
    watch = dispatch.fleet
    if not watch.knows(vehicle):
        raise unknown_vehicle(vehicle)
    if report.vehicle != vehicle:
        problem, mend = "not the vehicle of the path", "name the same vehicle in both"
        raise InputError(SOURCE, problem, mend, key="vehicle")
    if not isinstance(report, VehicleProgress) and watch.speaks_itself(vehicle):
        problem, mend = f"{vehicle} speaks for itself on the bus", "report vehicles without a bus"
        raise Problem(409, problem, mend, field="vehicle")
    watch.take(report, SOURCE)
    fleet = watch.fleet

    def found(tracker: FleetTracker) -> VehicleStatus:
        known, orders = tracker.vehicles.get(vehicle), len(tracker.book.held_by(vehicle))
        if known is None:
            # Before the first cycle nothing is tracked; the report is kept until then.
            assert fleet is not None
            definition = fleet.vehicle_by_id[vehicle]
            known = TrackedVehicle(definition, fleet.depot_of(definition))
        return _status(known, orders, fleet, watch.now_ns())

    return watch.read(found)


def _known(vehicle: TrackedVehicle | None, name: str) -> TrackedVehicle:
    if vehicle is None:
        raise unknown_vehicle(name)
    return vehicle


def unknown_vehicle(name: str) -> Problem:
    """The refusal of a vehicle that the fleet does not have."""
    mend = "take an id that GET /v1/vehicles lists"
    return Problem(404, f"no vehicle {name!r}", mend, field="vehicle")


def _status(
    vehicle: TrackedVehicle, orders: int, fleet: Fleet | None, now_ns: int
) -> VehicleStatus:
    own = vehicle.definition
    return VehicleStatus(
        id=vehicle.id,
        depot=DepotPlace(id=vehicle.depot.id, node=vehicle.depot.node),
        carrier=own.carrier,
        type=own.type,
        type_data=own.own_type if fleet is None else fleet.type_of(own),
        capacity=own.capacity,
        skills=own.skills,
        first_stop=own.first_stop,
        time_zone=None if fleet is None else fleet.time_zone,
        shift=Shift(**_times(own, own.clocks)),
        breaks=tuple(
            BreakTimes(duration_s=one.duration_s, **_times(one, one.clocks)) for one in own.breaks
        ),
        listed=vehicle.listed,
        reports=vehicle.has_telemetry,
        silent=vehicle.has_telemetry and not vehicle.is_fresh(now_ns),
        heard_ns=vehicle.answered_ns,
        orders=orders,
        position=vehicle.position,
        accepted=_summary(vehicle.accepted),
        offered=_summary(vehicle.offered),
        answer=vehicle.answer,
    )


def _times(row: object, clocks: Mapping[str, str | None]) -> dict[str, Any]:
    """Times by the clock, and the seconds of those that have none: those of the others are only
    what a cycle has made of them.
    """
    seconds = {f"{name}_s": getattr(row, f"{name}_s") for name in clocks if clocks[name] is None}
    return {**clocks, **dict.fromkeys(f"{name}_s" for name in clocks), **seconds}


def _summary(record: PlanRecord | None) -> PlanSummary | None:
    return None if record is None else PlanSummary(**_fate(record))


def _fate(record: PlanRecord) -> dict[str, Any]:
    fate = {name: getattr(record, name) for name in ("status", "since_ns", "reason")}
    return {"cycle": record.plan.cycle, **fate}


def _steps(
    stored: Iterable[PlanChange], pending: Iterable[PlanChange]
) -> dict[int, list[PlanChange]]:
    """A vehicle's plans' changes by cycle. What was pending may have been stored since."""
    known = list(stored)
    known += [change for change in pending if change not in known]
    steps: dict[int, list[PlanChange]] = {}
    for change in known:
        steps.setdefault(change.cycle, []).append(change)
    return steps


def _as_of_now(record: PlanRecord, steps: Mapping[int, list[PlanChange]]) -> PlanRecord:
    """A stored plan with what was not stored yet of it."""
    if record.plan.cycle not in steps:
        return record
    last = steps[record.plan.cycle][-1]
    return replace(record, status=last.status, since_ns=last.time_ns, reason=last.reason)


def _state(record: PlanRecord | None, steps: Mapping[int, list[PlanChange]]) -> PlanState | None:
    return None if record is None else _shown(record, steps)


def _shown(record: PlanRecord, steps: Mapping[int, list[PlanChange]]) -> PlanState:
    history = [
        PlanStep(time_ns=step.time_ns, status=step.status, reason=step.reason)
        for step in steps.get(record.plan.cycle, ())
    ]
    return PlanState(**_fate(record), plan=record.plan, history=history)
