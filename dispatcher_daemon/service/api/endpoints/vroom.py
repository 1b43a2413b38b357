"""Requests in VROOM's format, answered while the caller waits."""

from __future__ import annotations

import json
import time
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, Query
from fastapi.responses import JSONResponse, Response

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.body import describe_body, json_body
from dispatcher_daemon.service.api.endpoints.solve import road_task
from dispatcher_daemon.service.api.services import Dispatch
from dispatcher_daemon.service.api.solving import FullError, SolveJob
from dispatcher_daemon.service.api.solving.vroom import VroomTask
from dispatcher_daemon.service.vroom import INTERNAL_ERROR
from dispatcher_daemon.service.vroom.schema import Request as VroomRequest
from slipstream.errors import InputError
from slipstream.http.problems import FAULT, MEDIA_TYPE, Problem

DEADLINE_S: Final = 10.0
MAX_DEADLINE_S: Final = 50.0
WAIT_S: Final = 8.0
"""For jobs before it, s. One whose turn has not come by then is dropped."""
PATIENCE_S: Final = MAX_DEADLINE_S + WAIT_S
"""For all, below what proxies wait for an answer: beside the deadline a process may have to start,
and roads to be read."""

router = APIRouter(prefix="/v1/vroom", tags=["solve"], dependencies=[requires("control")])


@router.post(
    "",
    responses={200: {"model": dict[str, Any], "description": "VROOM's response."}},
    openapi_extra=describe_body(VroomRequest, "Vroom"),
)
def solve_vroom_request(
    dispatch: Dispatch,
    body: Annotated[object, Depends(json_body)],
    geometry: Annotated[bool, Query(description="Each route's way, as VROOM's -g.")] = False,
    choose_eta: Annotated[
        bool, Query(description="Only times are chosen, for the given steps, as VROOM's -c.")
    ] = False,
    deadline_s: Annotated[
        float, Query(gt=0, le=MAX_DEADLINE_S, description="For the answer, s.")
    ] = DEADLINE_S,
    seed: Annotated[int, Query(ge=0, lt=2**32, description="Of everything random.")] = 1,
) -> Response:
    """Solve a request in VROOM's format, by its matrices or by the roads in the traffic of now.

    A refusal has VROOM's `code` and `error` beside the members of a problem document.
    """
    jobs, ends = dispatch.solve_jobs, time.monotonic() + PATIENCE_S
    answer_by_ns = time.time_ns() + round(1e9 * PATIENCE_S)

    def make_task() -> VroomTask:
        return VroomTask(
            **road_task(dispatch),
            seed=seed,
            request=body,
            deadline_s=deadline_s,
            answer_by_ns=answer_by_ns,
            geometry=geometry,
            choose_eta=choose_eta,
        )

    try:
        job = jobs.submit(deadline_s, make_task)
    except FullError:
        raise _busy("other jobs are solved") from None
    try:
        begun = jobs.wait_begun(job, WAIT_S)
        if begun:
            jobs.wait(job, ends - time.monotonic())
    finally:
        jobs.leave(job)
    if job.result is None:
        if job.state == "failed":
            raise _failure(job)
        slow = f"no answer within {PATIENCE_S:g} s, the start of a process and reading roads too"
        raise _busy(slow if begun else "other jobs are solved")
    answer = json.loads(job.result)
    if answer["code"] == 0:
        return Response(job.result, media_type="application/json")
    if answer["code"] == INTERNAL_ERROR:
        raise FAULT
    refusal = Problem(422, answer["detail"], answer["mend"], field=answer.get("field")).document
    vroom = {name: answer[name] for name in ("code", "error", "warnings") if name in answer}
    return JSONResponse({**refusal, **vroom}, 422, media_type=MEDIA_TYPE)


def _busy(problem: str) -> Problem:
    return Problem(503, problem, "try again later", headers={"Retry-After": "10"})


def _failure(job: SolveJob) -> Problem:
    if isinstance(job.error, InputError):
        # The request is sound: only the network's file can be in the way.
        return Problem(503, str(job.error), job.error.mend, headers={"Retry-After": "30"})
    return Problem(500, f"the job failed: {job.reason}")
