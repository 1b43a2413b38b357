"""What every request passes before its route: who it is, how often, how many at once, how large."""

from __future__ import annotations

import logging
import time
from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api.auth import TokenFile, identify
from slipstream.config import MAX_JSON_BYTES
from slipstream.http.bodies import WITH_BODY, received
from slipstream.http.guard import answer
from slipstream.http.problems import Problem
from slipstream.http.rate import RateLimit
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

OPEN_PATHS: Final = frozenset({"/healthz", "/readyz", "/metrics"})
"""For probes: no token, no rate."""
MAX_BODY_BYTES: Final = 1_000_000
LARGE_BODIES: Final = {"/v1/solve": MAX_JSON_BYTES, "/v1/vroom": MAX_JSON_BYTES}
"""Paths that take whole fleets, or matrices."""
RATE_PER_S: Final = 200.0
BURST: Final = 400.0
"""Requests of one token."""
MAX_RUNNING: Final = 64
"""Requests that are worked on at once, event streams included."""

_REFUSED: Final = "\0"
"""Those whose token does not count share one rate; no token has this name."""


class ApiGuard:
    """ASGI middleware around the whole application; used in one event loop.

    Args:
        tokens: None: there is no file of tokens.
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

        def started(message: Message) -> None:
            metrics.API_REQUESTS.labels(str(message["status"])).inc()

        self._running += 1
        try:
            await answer(
                self._app,
                scope,
                send,
                lambda: self._admitted(scope, receive),
                started,
                log,
                self._limiter,
            )
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
        if scope["method"] not in WITH_BODY:
            return receive
        limit = LARGE_BODIES.get(path, MAX_BODY_BYTES)
        return await received(headers, receive, limit)

    def _slow_down(self, caller: str) -> None:
        wait_s = self._rate.wait_s(caller, time.monotonic())
        if wait_s > 0:
            detail = f"more than {self._rate.rate_per_s:g} requests a second"
            after = str(max(1, round(wait_s)))
            raise Problem(429, detail, "send fewer", headers={"Retry-After": after})
