"""The stream of events to a caller: heartbeats, and an end for one that reads too slowly."""

from __future__ import annotations

import asyncio
import time
from typing import Annotated, Final

from fastapi import APIRouter, Header, Query
from fastapi.responses import Response
from starlette.types import Receive, Scope, Send

from dispatcher_daemon import metrics
from dispatcher_daemon.api.auth import requires
from dispatcher_daemon.api.gate import abort
from dispatcher_daemon.api.hub import KINDS, MAX_STREAMS, EventHub, Kind, Stream
from dispatcher_daemon.api.problems import Problem
from dispatcher_daemon.api.services import Dispatch

HEARTBEAT_S: Final = 15.0
SEND_WITHIN_S: Final = 10.0
"""Time in which a caller has to take what is sent, before it is dropped."""
MAX_AGE_S: Final = 3600.0
"""After so long a stream ends, so that a token that was withdrawn counts for no longer."""
_PATTERN: Final = f"^({'|'.join(KINDS)})(,({'|'.join(KINDS)}))*$"

router = APIRouter(prefix="/v1/events", tags=["events"], dependencies=[requires("read")])


class EventStream(Response):
    """Sends a stream's events until its caller goes, is too slow, or the dispatcher ends."""

    media_type = "text/event-stream"

    def __init__(self, hub: EventHub, stream: Stream) -> None:
        super().__init__(headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"})
        self._hub, self._stream = hub, stream
        del self.headers["content-length"]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send."""
        stream = self._stream
        ends = time.monotonic() + MAX_AGE_S

        async def put(body: bytes, *, more: bool = True) -> None:
            async with asyncio.timeout(SEND_WITHIN_S):
                await send({"type": "http.response.body", "body": body, "more_body": more})

        async def follow() -> None:
            while (await receive())["type"] != "http.disconnect":
                pass
            stream.close()

        watching = asyncio.create_task(follow())
        metrics.API_STREAMS.inc()
        try:
            start = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
            await send(start)
            await put(b"retry: 3000\n\n")
            while not stream.closed and time.monotonic() < ends:
                events = await stream.take(HEARTBEAT_S)
                await put(b"".join(event.encoded for event in events) or b": heartbeat\n\n")
            if not stream.dropped:
                await put(b"", more=False)
        except TimeoutError:
            stream.dropped = True
        finally:
            watching.cancel()
            self._hub.close(stream)
            metrics.API_STREAMS.dec()
            if stream.dropped:
                metrics.API_STREAMS_DROPPED.inc()
                abort(scope)


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
    dispatch: Dispatch,
    kinds: Annotated[
        str, Query(pattern=_PATTERN, description="Which events, separated by commas.")
    ] = ",".join(KINDS),
    last_event_id: Annotated[
        str | None, Header(max_length=100, description="Go on behind this event.")
    ] = None,
) -> Response:
    """Server-sent events. Plans, cycles and orders have ids; `reset` says that some are lost."""
    wanted: list[Kind] = [kind for kind in KINDS if kind in kinds.split(",")]
    stream = dispatch.events.open(wanted, last_event_id)
    if stream is None:
        detail = f"{MAX_STREAMS} event streams are open"
        raise Problem(503, detail, "close one of them", headers={"Retry-After": "10"})
    return EventStream(dispatch.events, stream)
