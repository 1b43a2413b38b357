"""The API's server on loopback, with what happens for callers that listen and plan."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final, Self

from starlette.types import ASGIApp

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api.app import create_app
from dispatcher_daemon.service.api.auth import TokenFile
from dispatcher_daemon.service.api.guard import BURST, RATE_PER_S, ApiGuard
from dispatcher_daemon.service.api.hub import EventHub
from dispatcher_daemon.service.api.services import Services
from dispatcher_daemon.service.api.solving import SolveJobs
from slipstream.http.rate import RateLimit
from slipstream.http.server import HttpServer

HOST: Final = "127.0.0.1"


class ApiServer:
    """Serves the API on loopback from `start` until it is closed; a context manager.

    Args:
        port: on `HOST`; 0: a free one.
        tokens: file of bearer tokens; None: callers of this machine may read.
        events: what happens; None: nothing has yet.

    Raises:
        InputError: the port is taken, or the file of tokens is missing or faulty.
    """

    def __init__(
        self,
        port: int,
        tokens: Path | None = None,
        rate: RateLimit | None = None,
        events: EventHub | None = None,
    ) -> None:
        self._tokens = None if tokens is None else TokenFile(tokens)
        self._rate = rate or RateLimit(RATE_PER_S, BURST)
        self._server = HttpServer(
            "the API",
            HOST,
            port,
            "api.port",
            refused=lambda status: metrics.API_REQUESTS.labels(str(status)).inc(),
            failed=metrics.API_FAILURES.inc,
        )
        self.port = self._server.port
        self.events = events or EventHub(time.time_ns())
        self.solve_jobs = SolveJobs()

    def guarded(self, app: ASGIApp) -> ASGIApp:
        """An application behind what every request passes."""
        return ApiGuard(app, self._tokens, self._rate)

    def start(self, services: Services) -> None:
        """Serve; connections that came since the port was bound have waited."""
        self._server.start(self.guarded(create_app(services)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all connections and the threads."""
        self.events.close_all()
        self._server.close()
        self.solve_jobs.close()
