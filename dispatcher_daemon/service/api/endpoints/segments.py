"""Road segments: the latest states, and what the gates would be if a cycle began now."""

from __future__ import annotations

import time

from fastapi import APIRouter
from pydantic import BaseModel, Field

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.parameters import After, Limit, Name
from dispatcher_daemon.service.api.services import Dispatch, Services
from dispatcher_daemon.traffic import judge
from slipstream.http.problems import Problem
from slipstream.messages import Gate, SegmentState, TimeNs

router = APIRouter(prefix="/v1/segments", tags=["segments"], dependencies=[requires("read")])


class SegmentStatus(BaseModel):
    """One segment of the road network."""

    id: str
    start: str = Field(description="Junction that it begins at.")
    end: str = Field(description="Junction that it ends at.")
    length_m: float
    speed_limit_mps: float
    gate: Gate = Field(description="As a cycle that began now would judge it.")
    states: list[SegmentState] = Field(description="The latest of each RSU that watches it.")


class SegmentPage(BaseModel):
    """Segments by id that an RSU has reported on since the dispatcher's start."""

    time_ns: TimeNs = Field(description="Moment that the gates were judged for.")
    segments: list[SegmentStatus]
    next: str | None = Field(description="`after` of the next page; null: there is none.")


@router.get("")
def list_segments(dispatch: Dispatch, limit: Limit = 100, after: After = None) -> SegmentPage:
    """Watched segments."""
    now_ns = time.time_ns()
    names = [name for name in dispatch.states.segments() if after is None or name > after]
    return SegmentPage(
        time_ns=now_ns,
        segments=[_status(dispatch, name, now_ns) for name in names[:limit]],
        next=names[limit - 1] if len(names) > limit else None,
    )


@router.get("/{segment:path}")
def get_segment(dispatch: Dispatch, segment: Name) -> SegmentStatus:
    """One segment of the network, whether somebody watches it or not."""
    if segment not in dispatch.network.segments:
        mend = f"take a segment of network {dispatch.network.name!r}"
        raise Problem(404, f"no segment {segment!r}", mend, field="segment")
    return _status(dispatch, segment, time.time_ns())


def _status(dispatch: Services, name: str, now_ns: int) -> SegmentStatus:
    segment, states = dispatch.network.segments[name], dispatch.states.of(name)
    traffic = judge(segment, states, now_ns, dispatch.settings.stale_after_s)
    return SegmentStatus(
        id=name,
        start=segment.start,
        end=segment.end,
        length_m=segment.length_m,
        speed_limit_mps=segment.speed_limit_mps,
        gate=traffic.as_message(),
        states=list(states),
    )
