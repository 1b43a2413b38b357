"""Stored cycles: what solvers said, which gates were open, what was saved, which plans went out."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.parameters import Before, Limit, Moment, Number, check_range
from dispatcher_daemon.service.api.services import Dispatch
from slipstream.explain import Explanation, explanation
from slipstream.http.problems import Problem
from slipstream.messages import CycleReport, VehiclePlan
from storage import StoredCycle

router = APIRouter(prefix="/v1/cycles", tags=["cycles"], dependencies=[requires("read")])


class CyclePage(BaseModel):
    """Cycles by number, latest first."""

    cycles: list[CycleReport]
    next: int | None = Field(description="`before` of the next page; null: there is none.")


class CycleDetail(BaseModel):
    """One cycle and the plans that it published."""

    report: CycleReport
    plans: list[VehiclePlan]


@router.get("")
def list_cycles(
    dispatch: Dispatch,
    limit: Limit = 20,
    before: Before = None,
    since: Annotated[
        Moment, Query(alias="from", description="UTC in ns; cycles that began before are left out.")
    ] = None,
    until: Annotated[
        Moment, Query(description="UTC in ns; cycles that began then or later are left out.")
    ] = None,
) -> CyclePage:
    """The last cycles, or the last ones of a range of time, without their gates: those are in
    `/v1/cycles/{number}`.
    """
    check_range(since, until)
    # A city's cycle has some 10,000 gates.
    some = dispatch.reader.cycles(limit + 1, before, gates=False, begin_ns=since, end_ns=until)
    found = some[::-1]
    following = found[limit - 1].cycle if len(found) > limit else None
    page = [report.model_copy(update={"gates": ()}) for report in found[:limit]]
    return CyclePage(cycles=page, next=following)


@router.get("/{number}")
def get_cycle(dispatch: Dispatch, number: Number) -> CycleDetail:
    """One cycle."""
    report = dispatch.reader.cycle(number)
    if report is None:
        raise _unknown(number)
    return CycleDetail(report=report, plans=list(dispatch.reader.plans(number)))


@router.get("/{number}/explain")
def explain_cycle(
    dispatch: Dispatch,
    number: Number,
    vehicle: Annotated[
        str | None,
        Query(min_length=1, max_length=200, description="Only what concerns this vehicle."),
    ] = None,
) -> Explanation:
    """Why each vehicle goes where it goes, which platoons were refused and why, in words and with
    the figures behind them.
    """
    stored: StoredCycle | None = dispatch.reader.stored_cycle(number)
    if stored is None:
        raise _unknown(number)
    record = None if stored.inputs is None else stored.inputs.record
    found = explanation(stored.report, stored.plans, record)
    if vehicle is None:
        return found
    own = found.of_vehicle(vehicle)
    if own is None:
        mend = "take a vehicle that the whole explanation has"
        raise Problem(404, f"cycle {number} has no such vehicle", mend, field="vehicle")
    return own


def _unknown(number: int) -> Problem:
    mend = "take a number that GET /v1/cycles lists; old cycles are deleted"
    return Problem(404, f"no cycle {number} is stored", mend, field="number")
