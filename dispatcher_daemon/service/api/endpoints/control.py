"""Pause and resume the dispatcher, have a cycle now."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, FastAPI, Request, Response
from pydantic import BaseModel, Field

from dispatcher_daemon.service.api.auth import Client, requires
from dispatcher_daemon.service.api.body import describe_optional_body, optional_body_of
from dispatcher_daemon.service.api.services import Dispatch
from dispatcher_daemon.service.dispatcher import ControlRefused
from dispatcher_daemon.service.intake import Given
from slipstream.http.problems import Problem

router = APIRouter(prefix="/v1/control", tags=["control"], dependencies=[requires("control")])


Why = Annotated[Given, optional_body_of(Given)]
_BODY: Final = describe_optional_body(Given)


class ControlState(BaseModel):
    """Whether cycles run."""

    paused: bool
    paused_by: str | None = Field(description="Name of the token that paused it; null: none did.")
    paused_ns: int | None = Field(description="UTC of that.")


@router.post("/pause", openapi_extra=_BODY)
def pause(dispatch: Dispatch, request: Request, why: Why) -> ControlState:
    """Have no cycle begin and no order put into plans until it is resumed, over restarts too. A
    cycle that runs ends as usual; vehicles go on by the plans that they have.
    """
    dispatch.control.pause(actor_of(request), why.reason)
    return _state(dispatch)


@router.post("/resume", openapi_extra=_BODY)
def resume(dispatch: Dispatch, request: Request, why: Why) -> ControlState:
    """Have cycles run again, the first one at once."""
    dispatch.control.resume(actor_of(request), why.reason)
    return _state(dispatch)


@router.post("/cycle", status_code=202, openapi_extra=_BODY)
def run_cycle(dispatch: Dispatch, request: Request, why: Why) -> ControlState:
    """Have a cycle run now. Refused while it is paused, or one runs."""
    dispatch.control.cycle(actor_of(request), why.reason)
    return _state(dispatch)


def actor_of(request: Request) -> str:
    """The name of a request's token."""
    client: Client = request.state.client
    assert client.name is not None  # No scope but read is without a token.
    return client.name


def handle_refusals(app: FastAPI) -> None:
    """Have an application answer what cannot be done now as problem documents."""

    def refused(_request: Request, error: ControlRefused) -> Response:
        return Problem(409, error.problem, error.mend).response()

    app.add_exception_handler(ControlRefused, refused)  # type: ignore[arg-type]


def _state(dispatch: Dispatch) -> ControlState:
    paused = dispatch.control.paused
    return ControlState(
        paused=paused is not None,
        paused_by=None if paused is None else paused.by,
        paused_ns=None if paused is None else paused.since_ns,
    )
