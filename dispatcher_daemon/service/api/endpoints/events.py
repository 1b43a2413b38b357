"""The stream of events to a caller: heartbeats, and an end for one that reads too slowly."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from typing import Annotated, Final

from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import Response

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api.auth import Client, requires
from dispatcher_daemon.service.api.hub import KINDS, EventHub, Kind, Stream
from dispatcher_daemon.service.api.services import Dispatch
from slipstream.http.streaming import EndlessResponse

HEARTBEAT_S: Final = 15.0
SEND_WITHIN_S: Final = 10.0
"""Time in which a caller has to take what is sent, before it is dropped."""
MAX_AGE_S: Final = 3600.0
"""After so long a stream ends, so that a token that was withdrawn counts for no longer."""
_PATTERN: Final = f"^({'|'.join(KINDS)})(,({'|'.join(KINDS)}))*$"

router = APIRouter(prefix="/v1/events", tags=["events"], dependencies=[requires("read")])


async def _parts(stream: Stream) -> AsyncIterator[bytes]:
    """What the stream's caller is sent, until it is closed or too old."""
    ends = time.monotonic() + MAX_AGE_S
    yield b"retry: 3000\n\n"
    while not stream.closed and time.monotonic() < ends:
        events = await stream.take(HEARTBEAT_S)
        yield b"".join(event.encoded for event in events) or b": heartbeat\n\n"


def _response(hub: EventHub, stream: Stream) -> Response:
    def end(slow: bool) -> None:
        hub.close(stream)
        metrics.API_STREAMS.dec()
        if slow:
            metrics.API_STREAMS_DROPPED.inc()

    metrics.API_STREAMS.inc()
    return EndlessResponse(
        _parts(stream), "text/event-stream", send_within_s=SEND_WITHIN_S, end=end
    )


@router.get(
    "",
    response_class=Response,
    responses={
        200: {
            "description": "Events until either side ends.",
            "content": {"text/event-stream": {"schema": {"type": "string"}}},
        }
    },
)
async def follow_events(
    request: Request,
    dispatch: Dispatch,
    kinds: Annotated[
        str, Query(pattern=_PATTERN, description="Which events, separated by commas.")
    ] = ",".join(KINDS),
    last_event_id: Annotated[
        str | None, Header(max_length=100, description="Go on behind this event.")
    ] = None,
) -> Response:
    """Server-sent events. All but states have ids; `reset` says that some are lost."""
    wanted: list[Kind] = [kind for kind in KINDS if kind in kinds.split(",")]
    client: Client = request.state.client
    address = "unknown" if request.client is None else request.client.host
    caller = f"the address {address}" if client.name is None else f"the token {client.name!r}"
    return _response(dispatch.events, dispatch.events.open(wanted, last_event_id, caller))
