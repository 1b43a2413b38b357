"""A server of one application: a thread with its own event loop, bounded connections, started anew
if it fails. What happens in it never stops the daemon.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from slipstream.errors import InputError
from slipstream.http.conventions import Conventions
from slipstream.http.problems import MEDIA_TYPE, Problem

log = logging.getLogger(__name__)

MAX_CONNECTIONS: Final = 256
HEAD_WITHIN_S: Final = 10.0
"""Time in which a connection's request has to begin."""
RESTART_AFTER_S: Final = 5.0
_STOP_WITHIN_S: Final = 3
_BACKLOG: Final = 128


class BoundedConnection(H11Protocol):
    """A connection that is refused beyond `MAX_CONNECTIONS` and closed if no request comes.

    Args:
        refused: called with the status of what no application has seen.
    """

    _head_timer: asyncio.TimerHandle | None = None

    def __init__(self, *arguments: Any, refused: Callable[[int], None], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._refused = refused

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take the connection in."""
        super().connection_made(transport)
        # Copied into each request's scope: see `slipstream.http.bodies.abort`.
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
        self._refused(problem.status)
        body = bytes(problem.response().body)
        head = (
            f"HTTP/1.1 {problem.status} {problem.document['title']}\r\n"
            f"content-type: {MEDIA_TYPE}\r\ncontent-length: {len(body)}\r\n"
            "connection: close\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.transport.close()


class HttpServer:
    """Serves an application from `start` until it is closed.

    Args:
        port: TCP port; 0: a free one.
        key: setting of the port, for errors.
        refused: called with the status of what no application has seen.
        failed: called each time it has gone down.

    Attributes:
        port: that is served on.

    Raises:
        InputError: the address cannot be bound, as when the port is taken.
    """

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        key: str,
        *,
        refused: Callable[[int], None] = lambda _: None,
        failed: Callable[[], None] = lambda: None,
    ) -> None:
        self._name, self._host, self._key = name, host, key
        self._refused, self._failed = refused, failed
        self._app: ASGIApp | None = None
        self._socket: socket.socket | None = self._bound(port)
        self.port: int = self._socket.getsockname()[1]
        self._stopping = threading.Event()
        self._server: uvicorn.Server | None = None
        self._thread = threading.Thread(target=self._serve, name=name, daemon=True)

    def start(self, app: ASGIApp) -> None:
        """Serve; connections that came since the port was bound have waited."""
        self._app = Conventions(app)
        self._thread.start()

    def close(self) -> None:
        """End all connections and the thread."""
        self._stopping.set()
        if self._server is not None:
            self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join(_STOP_WITHIN_S + 2.0)
        if self._socket is not None:
            self._socket.close()

    def _serve(self) -> None:
        while not self._stopping.is_set():
            try:
                self._serve_once()
                reason = "it ended"
            except (Exception, SystemExit) as error:
                reason = f"{type(error).__name__}: {error}"
            if self._stopping.is_set():
                return
            self._failed()
            log.error("%s went down, again in %g s: %s", self._name, RESTART_AFTER_S, reason)
            self._stopping.wait(RESTART_AFTER_S)

    def _serve_once(self) -> None:
        assert self._app is not None
        sock, self._socket = self._socket or self._bound(self.port), None
        config = uvicorn.Config(
            self._app,
            http=partial(BoundedConnection, refused=self._refused),  # type: ignore[arg-type]
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

    def _bound(self, port: int) -> socket.socket:
        where = f"{self._host}:{port}"
        sock = None
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(
                self._host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )[0]
            sock = socket.socket(family, kind | socket.SOCK_CLOEXEC, protocol)
            # A port in TIME_WAIT is free, one with a listener is not.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(address)
            sock.listen(_BACKLOG)
        except OSError as error:
            if sock is not None:
                sock.close()
            problem = f"cannot serve {self._name}: {error.strerror or error}"
            raise InputError(where, problem, "choose a free port", key=self._key) from None
        return sock
