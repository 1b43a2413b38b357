"""The world as the command line has it: a process that is started, watched and ended."""

from __future__ import annotations

import contextlib
import os
import signal
import traceback
from collections.abc import Callable
from importlib.util import find_spec
from multiprocessing import get_context
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Final

from slipstream.errors import InputError
from slipstream.service import die_with_parent
from slipstream.service.memory import configure_allocator
from slipstream_lab.simulation.live.world_spec import CameraEndpoint, WorldCounts, WorldSpec
from slipstream_lab.simulation.sumo import check_files

_STOP_S: Final = 5.0
_POLL_S: Final = 0.2


def check_simulator() -> None:
    """Make sure that SUMO is installed. Raises ModuleNotFoundError: libsumo is not."""
    if find_spec("libsumo") is None:
        raise ModuleNotFoundError("No module named 'libsumo'", name="libsumo")


class WorldProcess:
    """A running world as a context manager: `with WorldProcess(order) as world`.

    Attributes:
        counts: the latest; None before the world has opened.

    Raises:
        InputError: a file is no SUMO file.
        ModuleNotFoundError: libsumo is not installed.
    """

    def __init__(self, spec: WorldSpec) -> None:
        check_simulator()
        check_files(spec.day.net, spec.day.files[1:])
        self.spec = spec
        self.counts: WorldCounts | None = None
        context = get_context("spawn")
        self._connection, self._other = context.Pipe()
        # Not daemonic: cameras are its children.
        self._process = context.Process(target=_serve, args=(self._other, os.getpid()))

    def __enter__(self) -> WorldProcess:
        self._process.start()
        self._other.close()
        # Not an argument: `start` waits for ever with one that a pipe cannot hold if the process
        # is ended before it has read it.
        with contextlib.suppress(OSError):
            self._connection.send(self.spec)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with contextlib.suppress(OSError):
            self._connection.send("stop")
        self._process.join(_STOP_S)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self._process.close()
        self._connection.close()

    def open(
        self, stopping: Callable[[], bool], progress: Callable[[float], None]
    ) -> tuple[CameraEndpoint, ...]:
        """Wait until the roads are full and the cameras serve; nothing if it is stopped before.

        Raises:
            InputError: SUMO refuses or dies of a file, or a stretch cannot be watched.
            ChildProcessError: a fault in the world.
        """
        while not stopping():
            if not self._connection.poll(_POLL_S):
                continue
            kind, content = self._receive()
            if kind == "warm":
                assert isinstance(content, float)
                progress(content)
            elif kind == "cameras":
                assert isinstance(content, list)
                return tuple(content)
        return ()

    def poll(self) -> None:
        """Receive the world's messages.

        Raises:
            InputError: SUMO refuses or dies of a vehicle.
            ChildProcessError: a fault in the world.
        """
        while self._connection.poll():
            _, content = self._receive()
            assert isinstance(content, WorldCounts)
            self.counts = content

    def _receive(self) -> tuple[str, object]:
        try:
            kind, content = self._connection.recv()
        except (EOFError, OSError):
            self._process.join()
            raise InputError(
                self.spec.day.source,
                f"SUMO crashes on them (exit status {self._process.exitcode})",
                "look for edges without connections, or run sumo on them",
            ) from None
        if kind == "refused":
            assert isinstance(content, InputError)
            raise content
        if kind == "fault":
            raise ChildProcessError(str(content))
        return kind, content


def _serve(connection: Connection, parent: int) -> None:
    """Run in the other process, and send what goes wrong: its terminal is SUMO's."""
    die_with_parent(parent)
    configure_allocator()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    from slipstream_lab.simulation.live.world import run_world

    try:
        spec: WorldSpec = connection.recv()
    except (EOFError, OSError):
        return
    try:
        run_world(spec, connection)
    except InputError as error:
        connection.send(("refused", error))
    except (BrokenPipeError, ConnectionResetError):
        return  # nobody listens any more
    except ChildProcessError as error:
        connection.send(("fault", str(error)))
    except Exception:
        connection.send(("fault", traceback.format_exc()))
