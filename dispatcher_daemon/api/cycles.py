"""Stored cycles: what solvers said, which gates were open, what was saved, which plans went out."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, Field

from dispatcher_daemon.api.auth import requires
from dispatcher_daemon.api.parameters import Before, Limit, Number
from dispatcher_daemon.api.problems import Problem
from dispatcher_daemon.api.services import Dispatch
from slipstream.messages import CycleReport, VehiclePlan

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
def list_cycles(dispatch: Dispatch, limit: Limit = 20, before: Before = None) -> CyclePage:
    """The last cycles."""
    found = dispatch.reader.cycles(limit + 1, before)[::-1]
    following = found[limit - 1].cycle if len(found) > limit else None
    return CyclePage(cycles=list(found[:limit]), next=following)


@router.get("/{number}")
def get_cycle(dispatch: Dispatch, number: Number) -> CycleDetail:
    """One cycle."""
    report = dispatch.reader.cycle(number)
    if report is None:
        mend = "take a number that GET /v1/cycles lists; old cycles are deleted"
        raise Problem(404, f"no cycle {number} is stored", mend, field="number")
    return CycleDetail(report=report, plans=list(dispatch.reader.plans(number)))
