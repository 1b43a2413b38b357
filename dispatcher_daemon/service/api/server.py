"""The API's server, on loopback and the bus, with what happens for callers that listen and plan."""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path
from typing import Final, Self

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api.app import create_app
from dispatcher_daemon.service.api.auth import TokenFile
from dispatcher_daemon.service.api.gate import BURST, RATE_PER_S, Gate
from dispatcher_daemon.service.api.hub import EventHub
from dispatcher_daemon.service.api.over_bus import ApiOverBus, Questioned
from dispatcher_daemon.service.api.services import Services
from dispatcher_daemon.service.api.solving import SolveJobs
from dispatcher_daemon.settings import Scope
from slipstream.http.rate import RateLimit
from slipstream.http.server import HttpServer

HOST: Final = "127.0.0.1"


class ApiServer:
    """Serves the API on loopback and over the bus from `start` until it is closed; a context
    manager.

    Args:
        port: on `HOST`; 0: a free one; None: it is not served over HTTP.
        tokens: file of bearer tokens; None: callers of this machine may read.
        rate: of each caller.
        over_bus: scopes that are served over the bus.

    Attributes:
        port: that is served on; 0: none.
        events: what happens is published there.
        solve_jobs: fleets that callers have planned.

    Raises:
        InputError: the port is taken, or the file of tokens is missing or faulty.
    """

    def __init__(
        self,
        port: int | None,
        tokens: Path | None = None,
        rate: RateLimit | None = None,
        over_bus: Collection[Scope] = (),
    ) -> None:
        self._tokens = None if tokens is None else TokenFile(tokens)
        self._rate = rate or RateLimit(RATE_PER_S, BURST)
        self._scopes = over_bus
        self._server: HttpServer | None = None
        self._over_bus: ApiOverBus | None = None
        if port is not None:
            self._server = HttpServer(
                "the API",
                HOST,
                port,
                "api.port",
                refused=lambda status: metrics.API_REQUESTS.labels(str(status)).inc(),
                failed=metrics.API_FAILURES.inc,
            )
        self.port = 0 if self._server is None else self._server.port
        self.events = EventHub(time.time_ns())
        self.solve_jobs = SolveJobs()

    def start(self, services: Services, bus: Questioned | None = None) -> None:
        """Serve; connections that came since the port was bound have waited.

        Args:
            bus: that is served over; None: none.
        """
        app = create_app(services)
        if self._server is not None:
            self._server.start(Gate(app, self._tokens, self._rate))
        if bus is not None and self._scopes:
            self._over_bus = ApiOverBus(app, self._scopes)
            self._over_bus.listen(bus)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all connections and the threads."""
        self.events.close_all()
        if self._server is not None:
            self._server.close()
        self.solve_jobs.close()
        if self._over_bus is not None:
            self._over_bus.close()
