"""What every request to the page passes: whose it is, how large it is, what its answer may do."""

from __future__ import annotations

import logging
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from dashboard import metrics
from dashboard.requests import check_names, warn_refused
from slipstream.http.bodies import WITH_BODY, received
from slipstream.http.guard import answer
from slipstream.http.problems import Problem
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

MAX_BODY_BYTES: Final = 64_000
MAX_EXPORT_BYTES: Final = 256_000
"""Of a request for a table as it is shown: the ids of the largest one fit into it."""
CSP: Final = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
HEADERS: Final = {
    "Content-Security-Policy": CSP,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""Of every answer."""


class PageGuard:
    """ASGI middleware around the whole application."""

    def __init__(self, app: ASGIApp, served: str, allowed: frozenset[str]) -> None:
        self._app, self._served, self._allowed = app, served, allowed
        self._limiter = LogLimiter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request; nothing is raised."""
        if scope["type"] != "http":
            return

        def started(message: Message) -> None:
            metrics.REQUESTS.labels(str(message["status"])).inc()
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers[name] = value
            # Pages of another version must not be mixed: each file is asked for again.
            headers.setdefault("Cache-Control", "no-cache")

        await answer(
            self._app,
            scope,
            send,
            lambda: self._admitted(scope, receive),
            started,
            log,
            self._limiter,
        )

    async def _admitted(self, scope: Scope, receive: Receive) -> Receive:
        headers = Headers(scope=scope)
        local = scope["server"][0] if scope.get("server") else ""
        refused = check_names(
            headers.getlist("host"), headers.getlist("origin"), self._served, self._allowed, local
        )
        if refused is not None:
            warn_refused(refused, self._limiter)
            raise Problem(
                403,
                f"not served for this {refused.header}",
                "the dashboard's log says which setting allows it",
                field=refused.header,
            )
        if scope["method"] not in WITH_BODY:
            return receive
        is_export = scope["path"].startswith("/api/export/")
        return await received(headers, receive, MAX_EXPORT_BYTES if is_export else MAX_BODY_BYTES)
