"""Alarms in force, what somebody acknowledges, and the log of what was told and done."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Annotated, Final

from fastapi import APIRouter, Path, Query, Request
from pydantic import BaseModel, Field

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.body import describe_optional_body, optional_body_of
from dispatcher_daemon.service.api.endpoints.control import actor_of
from dispatcher_daemon.service.api.parameters import Before, Limit
from dispatcher_daemon.service.api.services import Dispatch
from dispatcher_daemon.service.intake import Given
from slipstream.http.problems import Problem
from slipstream.messages import Alarm, Alarms, Identifier, Severity

DAY_NS: Final = 86_400_000_000_000

router = APIRouter(prefix="/v1", tags=["alarms"])


class Acknowledgement(Given):
    """Who knows of an alarm."""

    by: Identifier | None = Field(
        default=None, description="The operator; null: the name of the token."
    )


class LogEntry(BaseModel):
    """An alarm from its begin to its end, or something that was done."""

    number: int = Field(description="Its place among all; later ones have higher numbers.")
    time_ns: int = Field(description="UTC; of an alarm, its begin.")
    kind: str = Field(
        description="Of the alarm, or what was done: pause, resume, cycle, acknowledge; pin, "
        "release, settle or cancel of an order."
    )
    severity: Severity
    subject: str
    text: str
    mend: str | None
    actor: str | None = Field(
        description="Name of the token that did it, or `bus`: an order came there; null: an alarm."
    )
    alarm: str | None = Field(description="Id of the alarm; null: it is none.")
    ended_ns: int | None
    acknowledged_by: str | None
    acknowledged_ns: int | None


class LogPage(BaseModel):
    """Entries, latest first."""

    entries: list[LogEntry]
    next: int | None = Field(description="`before` of the next page; null: there is none.")


@router.get("/alarms", dependencies=[requires("read")])
def alarms(dispatch: Dispatch) -> Alarms:
    """Alarms in force and those that ended in the last ten minutes, as they are on the bus."""
    return dispatch.alarms.told()


@router.post(
    "/alarms/{alarm}/acknowledge",
    dependencies=[requires("control")],
    openapi_extra=describe_optional_body(Acknowledgement),
)
def acknowledge(
    dispatch: Dispatch,
    request: Request,
    alarm: Annotated[str, Path(min_length=1, max_length=64)],
    sent: Annotated[Acknowledgement, optional_body_of(Acknowledgement)],
) -> Alarm:
    """Say that somebody knows of an alarm. The first who does stays; it may be said again."""
    actor = actor_of(request)
    found = dispatch.alarms.acknowledge(alarm, sent.by or actor, actor, sent.reason)
    if found is None:
        detail = "no alarm with this id is in force or ended in the last ten minutes"
        raise Problem(404, detail, "see /v1/alarms for those there are", field="alarm")
    return found


@router.get("/log", dependencies=[requires("read")])
def log(
    dispatch: Dispatch,
    from_ns: Annotated[
        int | None,
        Query(alias="from", ge=0, lt=2**62, description="UTC ns; by default a day before `until`."),
    ] = None,
    until_ns: Annotated[
        int | None, Query(alias="until", ge=0, lt=2**62, description="UTC ns; by default now.")
    ] = None,
    limit: Limit = 100,
    before: Before = None,
) -> LogPage:
    """Alarms that began in a range of time, and what was done in it."""
    end_ns = time.time_ns() if until_ns is None else until_ns
    begin_ns = max(0, end_ns - DAY_NS) if from_ns is None else from_ns
    found = dispatch.reader.events(begin_ns, end_ns, limit=limit + 1, before=before)
    entries = [LogEntry.model_validate(asdict(event)) for event in found[:limit]]
    return LogPage(entries=entries, next=entries[-1].number if len(found) > limit else None)
