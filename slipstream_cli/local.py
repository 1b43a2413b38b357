"""What commands that run everything on one machine have in common: its port, its state folder."""

from __future__ import annotations

import fcntl
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from slipstream.errors import InputError


def http_status(address: str) -> int | None:
    """HTTP status of a page of this machine; None where nobody answers."""
    try:
        # Past any proxy of the environment: it is this machine's own page.
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with opener.open(address, timeout=2.0) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return int(error.code)
    except OSError:
        return None


def check_port_is_free(port: int) -> None:
    """Make sure that the page can be served.

    Raises:
        InputError: the port is no port, or taken.
    """
    if not 1 <= port <= 65535:
        raise InputError("--port", f"{port} is no port", "give 1 to 65535")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(
                f"127.0.0.1:{port}", f"{error.strerror}".lower(), "choose another with --port"
            ) from None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the state folder: two runs must not share a database.

    Raises:
        InputError: it cannot be made, or another run holds it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / "lock").open("w")
    except OSError as error:
        raise InputError(folder, f"{error.strerror}".lower(), "choose --state elsewhere") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                folder, "another run uses it", "stop that one or choose --state"
            ) from None
        yield
