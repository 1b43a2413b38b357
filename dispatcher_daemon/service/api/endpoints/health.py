"""Whether the dispatcher lives, whether it is ready, and its metrics."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response
from prometheus_client import REGISTRY
from prometheus_client.exposition import choose_encoder
from pydantic import BaseModel, Field

from dispatcher_daemon.service.api.services import Dispatch
from slipstream.http.problems import Problem

router = APIRouter(tags=["health"])


class Liveness(BaseModel):
    """The answer of a dispatcher that lives."""

    status: Literal["live"] = "live"


class CheckResult(BaseModel):
    """One condition of readiness."""

    ok: bool
    detail: str | None = Field(
        description="Why it is not met, or what has not been heard yet just after the start; null: "
        "nothing."
    )


class Readiness(BaseModel):
    """Whether the dispatcher can do its work now."""

    ready: bool
    paused: bool = Field(description="No cycle runs, as somebody has paused it; it is ready.")
    checks: dict[str, CheckResult]


@router.get("/healthz")
def healthz(dispatch: Dispatch) -> Liveness:
    """Whether cycles come and end, and have a solver. 503 if not."""
    if not dispatch.is_live():
        raise Problem(503, "a cycle hangs, or none is scheduled", "restart the dispatcher")
    if (fault := dispatch.solver_fault()) is not None:
        raise Problem(503, fault, "mend what it names, then restart the dispatcher")
    return Liveness()


@router.get("/readyz", responses={503: {"model": Readiness, "description": "It is not ready."}})
def readyz(dispatch: Dispatch) -> Response:
    """Whether database, bus, network, cycles and solvers work, an RSU of the settings sees its road
    and a vehicle reports; 503 if not.
    """
    checks, awaited = {}, dispatch.awaited()
    for name, check in dispatch.checks.items():
        detail = check()
        checks[name] = CheckResult(ok=detail is None, detail=detail or awaited.get(name))
    ready = all(result.ok for result in checks.values())
    paused = dispatch.control.paused is not None
    answer = Readiness(ready=ready, paused=paused, checks=checks)
    return JSONResponse(answer.model_dump(), 200 if ready else 503)


@router.get("/metrics", response_class=Response)
def metrics(request: Request) -> Response:
    """The process's metrics for Prometheus."""
    encode, content_type = choose_encoder(request.headers.get("accept", ""))
    return Response(encode(REGISTRY), media_type=content_type)
