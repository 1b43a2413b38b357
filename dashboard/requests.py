"""Requests to the web server: only those for its own page, from its own page, and a selection."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import gzip
import ipaddress
import logging
import re
from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from dashboard import selection
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

AUTHORITY: Final = re.compile(
    r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::(?P<port>\d{1,5}))?"
)
"""A host name or address, IPv6 in brackets, and a port."""

MAX_BROWSERS: Final = 32
"""Websockets of the 3D view at once: viser takes 0.2 MB for each, which the process keeps."""
MAX_CONNECTIONS: Final = 128
"""Connections at once, with those that have not sent a request yet or are sent a file."""
MAX_MESSAGE_BYTES: Final = 2**16
"""Of what a browser sends: cameras and clicks. As many as `websockets` queues may wait for each."""

_REFUSAL: Final = "Not served under this name. The dashboard's log says which setting allows it.\n"


@dataclass(frozen=True)
class Refused:
    """Why a request is refused.

    Attributes:
        header: the header that is not the page's own, Host or Origin.
        value: what it says; empty if it is missing.
    """

    header: str
    value: str


def check_names(
    hosts: Sequence[str],
    origins: Sequence[str],
    served: str,
    allowed: frozenset[str],
    local_address: str,
) -> Refused | None:
    """Check that a request is addressed to the page, and not sent by another site's page.

    A site whose name resolves to this address (DNS rebinding) is found by the Host, one whose
    scripts open a connection to this address by the Origin.

    Args:
        hosts: values of the header Host, as often as it was sent.
        origins: likewise of Origin.
        served: address or name that is served on, in lower case.
        allowed: further names of the page, in lower case.
        local_address: IP address that the request came in on.

    Returns:
        None for a request of the page's own.
    """
    host = AUTHORITY.fullmatch(hosts[0]) if len(hosts) == 1 else None
    if host is None or not _is_own(_name(host), allowed | {served}, local_address):
        return Refused("Host", ", ".join(hosts))
    if not origins:
        return None
    scheme, _, authority = origins[0].partition("://")
    origin = AUTHORITY.fullmatch(authority)
    if len(origins) > 1 or scheme not in ("http", "https") or origin is None:
        return Refused("Origin", ", ".join(origins))
    # A proxy may put its own address in the Host, or leave the port out.
    same_port = host["port"] in (None, origin["port"])
    if _name(origin) in allowed or (_name(origin) == _name(host) and same_port):
        return None
    return Refused("Origin", origins[0])


def warn_refused(refused: Refused, limiter: LogLimiter) -> None:
    """Log which setting allows what was refused."""
    if limiter.allow(refused.header):
        log.warning(
            "refused a request for %s %.100a (and %d before): if this is where your proxy "
            "serves the page, add the name to allowed_hosts in the dashboard's settings",
            refused.header,
            refused.value,
            limiter.suppressed(refused.header),
        )


def _name(authority: re.Match[str]) -> str:
    return authority["name"].lower().strip("[]")


def _is_own(name: str, names: frozenset[str], local_address: str) -> bool:
    if name in names or name == "localhost":
        return True
    with contextlib.suppress(ValueError):
        address = ipaddress.ip_address(name)
        return address.is_loopback or address == ipaddress.ip_address(local_address)
    return False


class SceneConnection(ServerConnection):
    """A connection that is cut off beyond `MAX_CONNECTIONS`.

    Attributes:
        is_browser: it has become a browser's websocket.
    """

    is_browser = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take the connection in."""
        if len(self.server.handlers) < MAX_CONNECTIONS:
            super().connection_made(transport)
            return
        # Without the server, which would start a task for it.
        super(ServerConnection, self).connection_made(transport)
        self.transport.abort()

    def beside(self) -> Iterator[SceneConnection]:
        """All that the server has."""
        return (other for other in self.server.handlers if isinstance(other, SceneConnection))


class Guard:
    """Examines the requests of one server, before viser does."""

    def __init__(
        self, served: str, allowed: frozenset[str], logger: logging.Logger, head: str = ""
    ) -> None:
        self.serving = False
        self._head = head.encode()
        self._served = served
        self._allowed = allowed
        self._logger = logger
        self._limiter = LogLimiter()

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """While viser starts, its call of websockets' `serve` gets this guard.

        viser passes no hook of its own on, and websockets has one for each request.
        """
        serve = websockets.asyncio.server.serve

        def guarded_serve(
            handler: Callable[[ServerConnection], Awaitable[None]],
            *arguments: Any,
            process_request: Callable[[ServerConnection, Request], Any],
            **options: Any,
        ) -> Any:
            def process(connection: ServerConnection, request: Request) -> Any:
                answer = (
                    self._refuse(connection, request)
                    or self._refuse_beyond(connection, request)
                    or _redirect(connection, request)
                )
                if answer is None and selection.of_path(request.path) is not None:
                    # The page is the same one; its websocket says what is selected.
                    request = Request("/", request.headers)
                return answer or _own_page(process_request(connection, request), self._head)

            async def handle(connection: ServerConnection) -> None:
                if not await self._reject_other_version(connection):
                    path = connection.request.path if connection.request else ""
                    selection.asked_for.set(selection.of_path(path))
                    await handler(connection)

            self.serving = True
            own = {"create_connection": SceneConnection, "max_size": MAX_MESSAGE_BYTES}
            return serve(
                handle, *arguments, process_request=process, logger=self._logger, **options | own
            )

        websockets.asyncio.server.serve = guarded_serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]

    def _refuse(self, connection: ServerConnection, request: Request) -> Response | None:
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        local_address = connection.local_address[0]
        refused = check_names(hosts, origins, self._served, self._allowed, local_address)
        if refused is None:
            return None
        warn_refused(refused, self._limiter)
        return connection.respond(HTTPStatus.FORBIDDEN, _REFUSAL)

    def _refuse_beyond(self, connection: ServerConnection, request: Request) -> Response | None:
        """503 for a websocket beyond `MAX_BROWSERS`."""
        assert isinstance(connection, SceneConnection)
        if request.headers.get("Upgrade", "").lower() != "websocket":
            return None
        if sum(other.is_browser for other in connection.beside()) < MAX_BROWSERS:
            connection.is_browser = True
            return None
        if self._limiter.allow("browsers"):
            before = self._limiter.suppressed("browsers")
            log.warning(
                "refused a browser (and %d before): %d follow the 3D view, the most there may be",
                before,
                MAX_BROWSERS,
            )
        detail = f"{MAX_BROWSERS} browsers follow the 3D view, the most there may be.\n"
        return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, detail)

    async def _reject_other_version(self, connection: ServerConnection) -> bool:
        """True if the browser's page is of another viser, which viser would print each time."""
        if connection.subprotocol == f"viser-v{viser.__version__}":
            return False
        if self._limiter.allow("version"):
            log.warning(
                "rejected a page of another version (and %d before); reload it in the browser",
                self._limiter.suppressed("version"),
            )
        await connection.close(1002, f"Version mismatch. Server: {viser.__version__}")
        return True


def _redirect(connection: ServerConnection, request: Request) -> Response | None:
    """For ``/?select=…``, the way to the page's path of that selection."""
    asked = selection.of_query(request.path) if "?select=" in request.path else None
    if asked is None or request.path.partition("?")[0] != "/":
        return None
    response = connection.respond(HTTPStatus.FOUND, "")
    # Relative, as a proxy may serve the page below a path of its own.
    response.headers["Location"] = asked.path().removeprefix("/")
    return response


_TITLE: Final = (b"<title>Viser</title>", b"<title>Slipstream in 3D</title>")
_ICON: Final = re.compile(rb'(<link\s+rel="icon"\s+href=")[^"]*(")')
_OWN_ICON: Final = (
    b"data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    b"%3Crect width='16' height='16' rx='3.5' fill='%230b5cad'/%3E%3Cpath d='M2.5 5h6M2.5 8h9.5"
    b"M2.5 11h4.5M9.6 5.3 12.6 8l-3 2.7' fill='none' stroke='%23fff' stroke-width='1.6' "
    b"stroke-linecap='round' stroke-linejoin='round'/%3E%3C/svg%3E"
)


def _own_page(answer: Any, head: bytes) -> Any:
    """viser's answer; its page gets the title, the icon and the head of this one.

    viser has no setting for them. A page that has neither mark is passed on as it is.
    """
    if not isinstance(answer, Response) or not answer.headers.get("Content-Type", "").startswith(
        "text/html"
    ):
        return answer
    answer.body = _rewritten(
        bytes(answer.body), answer.headers.get("Content-Encoding") == "gzip", head
    )
    if "Content-Length" in answer.headers:
        del answer.headers["Content-Length"]
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer


# viser keeps the page, plain and compressed: each is rewritten once.
@functools.lru_cache(maxsize=2)
def _rewritten(page: bytes, packed: bool, head: bytes) -> bytes:
    plain = gzip.decompress(page) if packed else page
    # After the title, so before viser's own script.
    plain = plain.replace(_TITLE[0], _TITLE[1] + head, 1)
    plain = _ICON.sub(rb"\g<1>" + _OWN_ICON + rb"\g<2>", plain, count=1)
    return gzip.compress(plain, 6, mtime=0) if packed else plain


class OneLine(logging.Filter):
    """Makes one line of a traceback, and lets one a minute through.

    What a client sends is no fault of ours: viser raises for it in a connection's handler, and in
    tasks of its own. That a browser leaves, even while it is answered, is no fault at all.
    """

    def __init__(self) -> None:
        super().__init__()
        self._limiter = LogLimiter()

    def filter(self, record: logging.LogRecord) -> bool:
        """Rewrite a record that has an exception, or leave it out."""
        error = record.exc_info[1] if record.exc_info else None
        if error is None:
            return True
        if isinstance(error, ConnectionClosed):
            return False
        if not self._limiter.allow(record.name):
            return False
        said, before = record.getMessage().partition("\n")[0], self._limiter.suppressed(record.name)
        record.msg, record.exc_info, record.exc_text = "%s (and %d before): %.200a", None, None
        record.args = (said, before, f"{type(error).__name__}: {error}")
        return True


ONE_LINE: Final = OneLine()
