"""Planning of a caller's own fleet on the dispatcher's roads: a job to submit, poll and cancel."""

from __future__ import annotations

import json
import time
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field

from dispatcher_daemon.fleet import Fleet, fleet_from
from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.body import SOURCE, describe_body, json_body
from dispatcher_daemon.service.api.parameters import Name
from dispatcher_daemon.service.api.services import Dispatch, Services
from dispatcher_daemon.service.api.solving import FullError, JobState, SolveJob
from dispatcher_daemon.service.api.solving.jobs import KEPT_S, MAX_WAITING
from dispatcher_daemon.service.api.solving.worker import (
    SolveResult,
    SolveTask,
    fingerprint,
    picklable,
)
from slipstream.http.problems import Problem
from slipstream.messages import TimeNs

MAX_DEADLINE_S: Final = 600.0

router = APIRouter(prefix="/v1/solve", tags=["solve"], dependencies=[requires("control")])


class FleetAccepted(BaseModel):
    """A fleet that could be planned."""

    valid: bool = True
    vehicles: int
    stops: int


class SolveStatus(BaseModel):
    """One job."""

    id: str
    state: JobState
    deadline_s: float = Field(description="Of its solvers, s.")
    submitted_ns: TimeNs
    started_ns: TimeNs | None
    ended_ns: TimeNs | None
    reason: str | None = Field(description="Why it failed, or was cancelled.")


class SolveAnswer(SolveStatus):
    """One job, with what came out."""

    result: SolveResult | None = Field(description="Of a job that is done.")


def _fleet_body() -> dict[str, Any]:
    described = describe_body(Fleet)
    for definition in described["x-body-definitions"].values():
        if "node" in definition.get("required", ()) and "lat" in definition["properties"]:
            # A place may be given by latitude and longitude instead.
            definition["required"].remove("node")
    return described


async def _fleet(request: Request, dispatch: Dispatch) -> Fleet:
    data = await json_body(request)
    return await run_in_threadpool(fleet_from, data, dispatch.network, SOURCE)


@router.post(
    "",
    status_code=202,
    responses={
        200: {"model": FleetAccepted, "description": "With `validate_only`."},
        202: {"model": SolveStatus, "description": "Poll the address in `Location`."},
    },
    openapi_extra=_fleet_body(),
)
def submit_solve(
    dispatch: Dispatch,
    fleet: Annotated[Fleet, Depends(_fleet)],
    validate_only: Annotated[bool, Query(description="Only check the fleet.")] = False,
    deadline_s: Annotated[
        float | None,
        Query(gt=0, le=MAX_DEADLINE_S, description="Of the solvers, s; by default a cycle's."),
    ] = None,
    seed: Annotated[
        int | None, Query(ge=0, lt=2**32, description="By default the dispatcher's.")
    ] = None,
) -> Response:
    """Plan a fleet, as in a fleet file, with the traffic of the moment that its turn comes."""
    if validate_only:
        accepted = FleetAccepted(vehicles=len(fleet.vehicles), stops=len(fleet.stops))
        return JSONResponse(accepted.model_dump())
    seconds = dispatch.settings.deadline_s if deadline_s is None else deadline_s

    def make_task() -> SolveTask:
        return _task(dispatch, fleet, seconds, seed)

    try:
        job = dispatch.solve_jobs.submit(seconds, make_task)
    except FullError:
        detail, headers = f"{MAX_WAITING} jobs are waiting", {"Retry-After": "10"}
        raise Problem(503, detail, "try again later", headers=headers) from None
    headers = {"Location": f"/v1/solve/{job.id}"}
    return JSONResponse(_status(job), 202, headers)


@router.get("/{job:path}", responses={200: {"model": SolveAnswer}})
def get_solve(dispatch: Dispatch, job: Name) -> Response:
    """One job, with its result if it is done."""
    found = _known(dispatch.solve_jobs.get(job), job)
    # The worker has written the result as JSON already.
    head = json.dumps(_status(found)).encode()
    whole = head[:-1] + b', "result": ' + (found.result or b"null") + b"}"
    return Response(whole, media_type="application/json")


@router.delete("/{job:path}", responses={200: {"model": SolveStatus}})
def cancel_solve(dispatch: Dispatch, job: Name) -> Response:
    """Cancel a job, whatever it is doing; one that has ended stays as it is."""
    return JSONResponse(_status(_known(dispatch.solve_jobs.cancel(job), job)))


def _known(job: SolveJob | None, name: str) -> SolveJob:
    if job is None:
        mend = f"submit it again; results are kept for {KEPT_S / 60:g} minutes"
        raise Problem(404, f"no job {name!r}", mend, field="job")
    return job


def _status(job: SolveJob) -> dict[str, Any]:
    return {name: getattr(job, name) for name in SolveStatus.model_fields}


def road_task(dispatch: Services) -> dict[str, Any]:
    """Fields of a `RoadTask` of now, but its seed."""
    now_ns = time.time_ns()
    return {
        "settings": dispatch.settings,
        "roads": fingerprint(dispatch.network),
        "states": dispatch.states.latest(),
        "learned": picklable(dispatch.fleet.learned(now_ns)),
        "now_ns": now_ns,
    }


def _task(dispatch: Services, fleet: Fleet, deadline_s: float, seed: int | None) -> SolveTask:
    settings = dispatch.settings
    interval_s = max(settings.interval_s, 2.0 * deadline_s)
    changed = {"deadline_s": deadline_s, "interval_s": interval_s}
    return SolveTask(
        **road_task(dispatch) | {"settings": settings.model_copy(update=changed)},
        fleet=fleet,
        seed=settings.seed if seed is None else seed,
    )
