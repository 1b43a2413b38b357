"""The API's server: one thread with its own event loop, bounded connections, started anew if it
fails. What happens in it never stops the dispatcher.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
import time
from pathlib import Path
from typing import Final, Self

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from dispatcher_daemon import metrics
from dispatcher_daemon.api.app import create_app
from dispatcher_daemon.api.auth import TokenFile
from dispatcher_daemon.api.gate import Gate, RateLimit
from dispatcher_daemon.api.hub import EventHub
from dispatcher_daemon.api.problems import MEDIA_TYPE, Problem
from dispatcher_daemon.api.services import Services
from dispatcher_daemon.api.solving import SolveJobs
from slipstream.errors import InputError

log = logging.getLogger(__name__)

HOST: Final = "127.0.0.1"
MAX_CONNECTIONS: Final = 256
HEAD_WITHIN_S: Final = 10.0
"""Time in which a connection's request has to begin."""
RESTART_AFTER_S: Final = 5.0
_STOP_WITHIN_S: Final = 3
_BACKLOG: Final = 128


class BoundedConnection(H11Protocol):
    """A connection that is refused beyond `MAX_CONNECTIONS` and closed if no request comes."""

    _head_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take the connection in."""
        super().connection_made(transport)
        # Copied into each request's scope: see `dispatcher_daemon.api.gate.abort`.
        self.app_state = {**self.app_state, "abort": transport.abort}
        if len(self.connections) > MAX_CONNECTIONS:
            self._refuse(Problem(503, f"{MAX_CONNECTIONS} connections are open", "close some"))
            return
        self._await_head()

    def data_received(self, data: bytes) -> None:
        """Take in what the caller sends."""
        if self.transport.is_closing():
            return
        super().data_received(data)
        if self._head_timer is not None and self._is_busy():
            self._head_timer.cancel()
            self._head_timer = None
        elif self._head_timer is None and not self._is_busy():
            self._await_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        if self._head_timer is not None:
            self._head_timer.cancel()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP."""
        self._refuse(Problem(400, "no HTTP request", "send HTTP/1.1"))

    def _is_busy(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    def _await_head(self) -> None:
        self._head_timer = self.loop.call_later(HEAD_WITHIN_S, self._close_idle)

    def _close_idle(self) -> None:
        if not self._is_busy():
            self.transport.abort()

    def _refuse(self, problem: Problem) -> None:
        metrics.API_REQUESTS.labels(str(problem.status)).inc()
        body = bytes(problem.response().body)
        head = (
            f"HTTP/1.1 {problem.status} {problem.document['title']}\r\n"
            f"content-type: {MEDIA_TYPE}\r\ncontent-length: {len(body)}\r\n"
            "connection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()


class ApiServer:
    """Serves the API on loopback from `start` until it is closed; a context manager.

    Args:
        port: on `HOST`; 0: a free one.
        tokens: file of bearer tokens; None: callers of this machine may read.
        rate: of each caller.

    Attributes:
        events: what happens is published there.
        solve_jobs: fleets that callers have planned.

    Raises:
        InputError: the port is taken, or the file of tokens is missing or faulty.
    """

    def __init__(
        self, port: int, tokens: Path | None = None, rate: RateLimit | None = None
    ) -> None:
        self._tokens = None if tokens is None else TokenFile(tokens)
        self._rate = rate or RateLimit()
        self._app: ASGIApp | None = None
        self._socket: socket.socket | None = _bound(port)
        self.port: int = self._socket.getsockname()[1]
        self.events = EventHub(time.time_ns())
        self.solve_jobs = SolveJobs()
        self._stopping = threading.Event()
        self._server: uvicorn.Server | None = None
        self._thread = threading.Thread(target=self._serve, name="api", daemon=True)

    def start(self, services: Services) -> None:
        """Serve; connections that came since the port was bound have waited."""
        self._app = Gate(create_app(services), self._tokens, self._rate)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all connections and the thread."""
        self._stopping.set()
        self.events.close_all()
        if self._server is not None:
            self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join(_STOP_WITHIN_S + 2.0)
        if self._socket is not None:
            self._socket.close()
        self.solve_jobs.close()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            try:
                self._serve_once()
                reason = "it ended"
            except (Exception, SystemExit) as error:
                reason = f"{type(error).__name__}: {error}"
            if self._stopping.is_set():
                return
            metrics.API_FAILURES.inc()
            log.error("the API went down, again in %g s: %s", RESTART_AFTER_S, reason)
            self._stopping.wait(RESTART_AFTER_S)

    def _serve_once(self) -> None:
        assert self._app is not None
        sock, self._socket = self._socket or _bound(self.port), None
        config = uvicorn.Config(
            self._app,
            http=BoundedConnection,
            loop="asyncio",
            ws="none",
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=_STOP_WITHIN_S,
        )
        # What clients send wrongly is counted by status; it must not fill the log.
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        self._server = uvicorn.Server(config)
        try:
            if not self._stopping.is_set():
                self._server.run(sockets=[sock])
        finally:
            sock.close()


def _bound(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
    try:
        # A port in TIME_WAIT is free, one with a listener is not.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((HOST, port))
        sock.listen(_BACKLOG)
    except OSError as error:
        sock.close()
        problem = f"cannot serve the API: {error.strerror}"
        address = f"{HOST}:{port}"
        raise InputError(address, problem, "choose a free port", key="api.port") from None
    return sock
