"""The stream of moments and changes to a browser."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Final

from fastapi import APIRouter, Header, Request
from fastapi.responses import Response

from dashboard import metrics
from dashboard.web.hub import GZIP_HEAD, HEARTBEAT, HubPart, PageHub, PageViewer
from dashboard.web.services import Page
from slipstream.http.problems import Problem
from slipstream.http.streaming import EndlessResponse

HEARTBEAT_S: Final = 2.0
SEND_WITHIN_S: Final = 10.0
"""Time in which a browser has to take what is sent, before it is cut off."""
_RETRY: Final = HubPart(b"retry: 1000\n\n")

router = APIRouter(prefix="/api/live")


@router.get("")
async def follow(
    page: Page, request: Request, accept_encoding: Annotated[str, Header()] = ""
) -> Response:
    """Server-sent events: a moment, then what changes."""
    hub = page.hub
    if hub is None:
        raise Problem(404, "a finished run is shown", "ask /api/past and /api/at")
    viewer = hub.open(f"the address {_address(request)}")
    gzip = "gzip" in accept_encoding.lower()
    return EndlessResponse(
        _parts(viewer, gzip),
        "text/event-stream",
        send_within_s=SEND_WITHIN_S,
        headers={"Content-Encoding": "gzip"} if gzip else {},
        end=lambda slow: _end(hub, viewer, slow),
    )


def _address(request: Request) -> str:
    """Of the caller; of a proxy on this machine the last one that it names."""
    address = "unknown" if request.client is None else request.client.host
    forwarded = request.headers.get("x-forwarded-for", "").rpartition(",")[2].strip()
    return forwarded[:45] if forwarded and address in ("127.0.0.1", "::1") else address


async def _parts(viewer: PageViewer, gzip: bool) -> AsyncIterator[bytes]:
    yield (GZIP_HEAD if gzip else b"") + _RETRY.of(gzip)
    while not viewer.closed:
        parts = await viewer.take(HEARTBEAT_S)
        yield b"".join(part.of(gzip) for part in parts or [HEARTBEAT])


def _end(hub: PageHub, viewer: PageViewer, slow: bool) -> None:
    hub.close(viewer)
    if slow:
        metrics.DROPPED.inc()
