from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from dispatcher_daemon.planning.routes import search_within
from dispatcher_daemon.settings import ClusterSettings
from dispatcher_daemon.solvers.cluster.client import Cluster
from dispatcher_daemon.solvers.exact import ExactSolver
from slipstream.bus import free_port

READY_S = 120.0
STRANGE = """
import sys
from dispatcher_daemon.solvers.cluster import calls
from dispatcher_daemon.solvers.cluster import members
calls.build = members.build = lambda: "slipstream 9.9.9"
from slipstream_cli.main import main
if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
"""


def wait_until(holds: Callable[[], bool]) -> None:
    """Poll a condition."""
    ends = time.monotonic() + READY_S
    while not holds():
        assert time.monotonic() < ends
        time.sleep(0.05)


class Members:
    """A scheduler and workers as processes of their own, on loopback.

    Attributes:
        settings: to reach them.
        scheduler: the process; None before `start_scheduler`.
        workers: the processes.
    """

    def __init__(self, folder: Path, **tls: Path) -> None:
        self._folder = folder
        address = f"tcp://127.0.0.1:{free_port()}"
        self.settings = ClusterSettings(address=address, **tls)
        keys = {"address": address, **tls}
        self._table = "[cluster]\n" + "".join(f'{key} = "{v}"\n' for key, v in keys.items())
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> None:
        """Start the scheduler, or start it again."""
        self.scheduler = self._start("scheduler", "")

    def start_worker(self, processes: int = 1, *, strange: bool = False) -> None:
        """Start another worker.

        Args:
            strange: of another build.
        """
        self.workers.append(self._start("worker", f"[worker]\nprocesses = {processes}\n", strange))

    def kill_worker(self) -> None:
        """Kill the worker that was started first."""
        worker = self.workers.pop(0)
        worker.send_signal(signal.SIGKILL)
        worker.wait(30)

    def kill_scheduler(self) -> None:
        """Kill the scheduler."""
        assert self.scheduler is not None
        self.scheduler.send_signal(signal.SIGKILL)
        self.scheduler.wait(30)

    def _start(self, role: str, keys: str, strange: bool = False) -> subprocess.Popen[bytes]:
        file = self._folder / f"{role}.toml"
        file.write_text(keys + self._table)
        program = ["-m", "slipstream_cli"]
        if strange:
            script = self._folder / "strange.py"
            script.write_text(STRANGE)
            program = [str(script)]
        with self.log_of(role).open("ab") as lines:
            return subprocess.Popen(
                [sys.executable, *program, role, "--config", str(file)], stderr=lines
            )

    def log_of(self, role: str) -> Path:
        """What the scheduler, or all workers, wrote."""
        return self._folder / f"{role}.log"

    def end(self) -> None:
        """Kill all that is left."""
        for process in (self.scheduler, *self.workers):
            if process is not None and process.poll() is None:
                process.kill()
                process.wait(30)


@pytest.fixture
def members(tmp_path: Path) -> Iterator[Members]:
    """A scheduler without workers."""
    found = Members(tmp_path)
    try:
        found.start_scheduler()
        yield found
    finally:
        found.end()


@pytest.fixture
def connected() -> Callable[[ClusterSettings, int], AbstractContextManager[Cluster]]:
    """A connection for a with statement."""

    @contextmanager
    def open_cluster(settings: ClusterSettings, slots: int) -> Iterator[Cluster]:
        cluster = Cluster(settings, slots, [ExactSolver()], (search_within, os.getpid))
        try:
            assert cluster.wait_for(slots, READY_S), f"{cluster.slots} processes of {slots}"
            yield cluster
        finally:
            cluster.close()

    return open_cluster
