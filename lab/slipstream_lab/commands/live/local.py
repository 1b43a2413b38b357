"""What commands that run everything on one machine share: port, state folder, the watch."""

from __future__ import annotations

import fcntl
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from slipstream.errors import InputError
from slipstream.service.memory import TRIM_INTERVAL_S, trim_memory
from slipstream_cli.place.site_file import scene_port_of
from slipstream_lab.commands.live.supervisor import Supervisor

_POLL_S = 0.1


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


def check_ports_are_free(port: int) -> None:
    """Make sure that the operator's page and the 3D view can be served. Raises InputError: the
    page's port is no port, or one of both is taken.
    """
    if not 1 <= port < 65535:
        mend = "give 1 to 65534; the 3D view has the next one"
        raise InputError("--port", f"{port} is no port", mend)
    for each in (port, scene_port_of(port)):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", each))
            except OSError as error:
                raise InputError(
                    f"127.0.0.1:{each}", f"{error.strerror}".lower(), "choose another with --port"
                ) from None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the state folder: two runs must not share a database. Raises InputError: it cannot be
    made, or another run holds it.
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


def watch(
    supervisor: Supervisor,
    port: int,
    seconds: float | None,
    stopping: threading.Event,
    look: Callable[[float], None] = lambda elapsed_s: None,
) -> int | None:
    """Look after the daemons until the end; returns the page's last HTTP status.

    Args:
        port: of the operator's page; the 3D view is at `scene_port_of` it.
        seconds: until the end; None: until `stopping` is set.
    """
    address, scene = (f"http://127.0.0.1:{at}" for at in (port, scene_port_of(port)))
    began = time.monotonic()
    status: int | None = None
    announced = False
    asked_s = trimmed_s = 0.0
    while not stopping.is_set() and supervisor.refused is None:
        elapsed = time.monotonic() - began
        if seconds is not None and elapsed >= seconds:
            return http_status(address)
        if not announced and elapsed - asked_s >= 1.0:
            asked_s = elapsed
            status = http_status(address)
            if status == 200:
                announced = True
                text = f"the dashboard is at {address}, its 3D view at {scene} (Ctrl-C stops all)"
                supervisor.say("slipstream", text)
        if elapsed - trimmed_s >= TRIM_INTERVAL_S:
            trimmed_s = elapsed
            trim_memory()
        supervisor.poll()
        look(elapsed)
        stopping.wait(_POLL_S)
    return status
