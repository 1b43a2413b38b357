"""The web server: on the address that was asked for or not at all, private, and quick to stop."""

from __future__ import annotations

import contextlib
import errno
import io
import logging
import socket
import threading
from typing import Final

import viser

from slipstream.errors import InputError

log = logging.getLogger(__name__)

STOP_TIMEOUT_S: Final = 3.0


def start_server(host: str, port: int) -> viser.ViserServer:
    """Start viser on exactly this address, with no way to open it to the world.

    Raises:
        InputError: the address cannot be bound, as when the port is taken.
    """
    check_address_free(host, port)
    # Each browser that comes or goes is no news.
    logging.getLogger("websockets").setLevel(logging.WARNING)
    # viser prints a banner to standard output, which belongs to our caller.
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, verbose=False)
    if server.get_port() != port:
        # Somebody was faster between our look and viser's, which then takes the next free port.
        stop_server(server)
        raise _port_in_use(host, port)
    # Any client can ask for a public tunnel to the page; hiding the button would not stop it.
    server.request_share_url = _refuse_share_url  # type: ignore[method-assign]
    return server


def stop_server(server: viser.ViserServer) -> None:
    """Stop viser; waits no longer than a few seconds for clients that do not let go."""

    def stop() -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()

    stopper = threading.Thread(target=stop, name="stop viser", daemon=True)
    stopper.start()
    stopper.join(STOP_TIMEOUT_S)
    if stopper.is_alive():
        log.info("left open connections to themselves")


def check_address_free(host: str, port: int) -> None:
    """See that an address can be bound now.

    Raises:
        InputError: it cannot.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        with socket.socket(family, kind, protocol) as probe:
            # As asyncio binds: a port in TIME_WAIT is free, one being listened on is not.
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


def _refuse_share_url(verbose: bool = True) -> None:
    log.warning("a client asked for a public share URL; refused")
