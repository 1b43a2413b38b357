"""The web server: exactly the given address, requests of its own page only, no public tunnel."""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import socket
import threading
import warnings
from collections.abc import Iterable
from typing import Final

import viser

from dashboard.requests import ONE_LINE, Guard
from slipstream.errors import InputError
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

STOP_TIMEOUT_S: Final = 3.0


def start_server(
    host: str, port: int, allowed_hosts: Iterable[str] = (), head: str = ""
) -> viser.ViserServer:
    """Start viser on exactly this address, without viser's public share URLs.

    A request whose Host is not a name of the page, or that another site's page sent, gets HTTP 403.

    Raises:
        InputError: the address cannot be bound, as when the port is taken.
    """
    check_address_free(host, port)
    connections = logging.getLogger(f"{__name__}.connections")
    # Each connection is logged at INFO.
    connections.setLevel(logging.WARNING)
    for logger in (connections, logging.getLogger("asyncio")):
        logger.addFilter(ONE_LINE)
    # A browser may go while it is sent to.
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
    guard = Guard(host.lower(), frozenset(map(str.lower, allowed_hosts)), connections, head)
    # viser prints a banner to standard output, which is the caller's.
    with contextlib.redirect_stdout(io.StringIO()), guard.installed():
        server = viser.ViserServer(host=host, port=port, verbose=False)
    if not guard.serving:
        stop_server(server)
        raise RuntimeError("this viser does not serve by websockets: requests would go unchecked")
    if server.get_port() != port:
        # Another process took the port after the check; viser then uses the next free one.
        stop_server(server)
        raise _port_in_use(host, port)
    # Any client can request a public tunnel to the page, even with the button hidden.
    server.request_share_url = _refuse_share_url  # type: ignore[method-assign]
    return server


def stop_server(server: viser.ViserServer) -> None:
    """Stop viser; waits at most `STOP_TIMEOUT_S` for clients to disconnect."""

    def stop() -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()

    stopper = threading.Thread(target=stop, name="stop viser", daemon=True)
    stopper.start()
    stopper.join(STOP_TIMEOUT_S)
    if stopper.is_alive():
        log.info("stopped with connections still open")


def check_address_free(host: str, port: int) -> None:
    """Check that an address can be bound.

    Raises:
        InputError: it cannot.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            # As asyncio binds: a port in TIME_WAIT is free, one with a listener is not.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            probe.listen(1)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise _port_in_use(host, port) from None
        reason = error.strerror or str(error)
        raise InputError(
            f"{host}:{port}", f"cannot serve here: {reason}", "give another host or port"
        ) from None


def _port_in_use(host: str, port: int) -> InputError:
    return InputError(
        f"{host}:{port}", "the port is taken", "stop what listens there, or give another port"
    )


_SHARE_LIMITER: Final = LogLimiter()


def _refuse_share_url(verbose: bool = True) -> None:
    if _SHARE_LIMITER.allow(""):
        before = _SHARE_LIMITER.suppressed("")
        log.warning("a client asked for a public share URL; refused (and %d before)", before)
