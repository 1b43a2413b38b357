"""What every request passes before its route: who it is, how often, how many at once, how large."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from dispatcher_daemon import metrics
from dispatcher_daemon.api.auth import TokenFile, identify
from dispatcher_daemon.api.problems import FAULT, Problem
from slipstream.config import MAX_JSON_BYTES
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

OPEN_PATHS: Final = frozenset({"/healthz", "/readyz", "/metrics"})
"""For probes: no token, no rate."""
MAX_BODY_BYTES: Final = 1_000_000
LARGE_BODIES: Final = {"/v1/solve": MAX_JSON_BYTES, "/v1/vroom": MAX_JSON_BYTES}
"""Paths that take whole fleets, or matrices."""
BODY_WITHIN_S: Final = 15.0
RATE_PER_S: Final = 200.0
BURST: Final = 400.0
"""Requests of one token."""
MAX_RUNNING: Final = 64
"""Requests that are worked on at once, event streams included."""

_REFUSED: Final = "\0"
"""Those whose token does not count share one rate; no token has this name."""
_WITH_BODY: Final = frozenset({"POST", "PUT", "PATCH", "DELETE"})


class DisconnectedError(Exception):
    """The caller went away in the middle of its request."""


class RateLimit:
    """A token bucket for each caller; callers are as many as there are tokens, so it is bounded."""

    def __init__(self, rate_per_s: float = RATE_PER_S, burst: float = BURST) -> None:
        self._rate_per_s, self._burst = rate_per_s, burst
        self._left: dict[str, tuple[float, float]] = {}

    def wait_s(self, caller: str, now_s: float) -> float:
        """Take one request; time until the next one is allowed, 0 if this one is, s."""
        left, then_s = self._left.get(caller, (self._burst, now_s))
        left = min(self._burst, left + (now_s - then_s) * self._rate_per_s)
        allowed = left >= 1.0
        self._left[caller] = (left - 1.0 if allowed else left), now_s
        return 0.0 if allowed else (1.0 - left) / self._rate_per_s


class Gate:
    """ASGI middleware around the whole application; used in one event loop.

    Args:
        app: behind it.
        tokens: None: there is no file of tokens.
        rate: of each caller.
    """

    def __init__(self, app: ASGIApp, tokens: TokenFile | None, rate: RateLimit) -> None:
        self._app = app
        self._tokens = tokens
        self._rate = rate
        self._running = 0
        self._limiter = LogLimiter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request; nothing is raised."""
        if scope["type"] != "http":
            return
        begun = ended = False

        async def counted(message: Message) -> None:
            nonlocal begun, ended
            if message["type"] == "http.response.start":
                begun = True
                metrics.API_REQUESTS.labels(str(message["status"])).inc()
            elif not message.get("more_body", False):
                ended = True
            await send(message)

        self._running += 1
        try:
            inner = await self._admitted(scope, receive)
            await self._app(scope, inner, counted)
        except Problem as problem:
            await problem.response()(scope, receive, counted)
        except DisconnectedError:
            pass
        except Exception as error:
            if self._limiter.allow("fault"):
                log.exception("%s %.200a failed: %s", scope["method"], scope["path"], error)
            if not begun:
                await FAULT.response()(scope, receive, counted)
            elif not ended:
                # The rest of the answer cannot be sent; the caller must not take it for whole.
                abort(scope)
        finally:
            self._running -= 1

    async def _admitted(self, scope: Scope, receive: Receive) -> Receive:
        """The request's body, received and replayed. Raises Problem."""
        headers, path = Headers(scope=scope), scope["path"]
        if path in OPEN_PATHS:
            return receive
        if self._running > MAX_RUNNING:
            detail = f"{MAX_RUNNING} requests are being worked on"
            raise Problem(503, detail, "try again later", headers={"Retry-After": "1"})
        try:
            tokens = None if self._tokens is None else self._tokens.current()
            client = identify(headers, tokens)
        except Problem:
            self._slow_down(_REFUSED)
            raise
        self._slow_down(client.name or "")
        scope["state"]["client"] = client
        if scope["method"] not in _WITH_BODY:
            return receive
        limit = LARGE_BODIES.get(path, MAX_BODY_BYTES)
        return await _received(headers, receive, limit)

    def _slow_down(self, caller: str) -> None:
        wait_s = self._rate.wait_s(caller, time.monotonic())
        if wait_s > 0:
            detail = f"more than {RATE_PER_S:g} requests a second"
            after = str(max(1, round(wait_s)))
            raise Problem(429, detail, "send fewer", headers={"Retry-After": after})


async def _received(headers: Headers, receive: Receive, limit: int) -> Receive:
    """The whole body, bounded in size and time, as a `Receive` for the application."""
    declared = headers.get("content-length", "0")
    too_large = Problem(
        413,
        f"the body is larger than {limit / 1e6:g} MB",
        "send less at once",
        headers={"Connection": "close"},
    )
    if not declared.isdecimal() or int(declared) > limit:
        raise too_large
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_WITHIN_S):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise DisconnectedError
                body += message.get("body", b"")
                if len(body) > limit:
                    raise too_large
                if not message.get("more_body", False):
                    break
    except TimeoutError:
        detail = f"the body did not come within {BODY_WITHIN_S:g} s"
        raise Problem(408, detail, "send it faster", headers={"Connection": "close"}) from None
    sent = False

    async def replayed() -> Message:
        nonlocal sent
        if sent:
            return await receive()
        sent = True
        return {"type": "http.request", "body": bytes(body), "more_body": False}

    return replayed


def abort(scope: Scope) -> None:
    """Close a request's connection at once, with what it has not taken yet."""
    close: Callable[[], None] = scope["state"]["abort"]
    close()
