"""Process supervisor of one machine's daemons: start, prefix logs, watch, restart, stop.

It is to the daemons what systemd is: each tells that it is ready and that its work goes on
(sd_notify). One that is silent for too long is ended and started again.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TextIO

from slipstream.service import SUPERVISED
from slipstream.service.logs import readable

RESTARTS_A_MINUTE: Final = 5
WATCHDOG_S: Final = 20.0
"""A daemon that is ready reports every 5 to 10 s; the rest is for a machine that stalls."""
_START_LIMIT_S: Final = 180.0
"""Until it is ready: the longest TimeoutStartSec of the units in deploy/systemd."""
_MAX_STEP_S: Final = 3.0
"""Of a longer time between two polls no more counts: the machine stalled, the daemons with it."""
_FIRST_WAIT_S: Final = 0.5
_STOP_S: Final = 7.0
_EXIT_BAD_INPUT: Final = 2


@dataclass
class _Child:
    name: str
    command: Sequence[str]
    notifications: socket.socket
    ready: bool = False
    silent_s: float = 0.0
    process: subprocess.Popen[str] | None = None
    printer: threading.Thread | None = None
    restarts: deque[float] = field(default_factory=deque)
    due_s: float = 0.0
    given_up: bool = False


class Supervisor:
    """Child processes, each with a name; call `poll` about ten times a second. `refused`: name of
    a process that ended for bad input and so is not started again.
    """

    def __init__(self, log: TextIO) -> None:
        self.restarted = 0
        self.refused: str | None = None
        self.given_up: list[str] = []
        self._log = log
        self._log_lock = threading.Lock()
        self._children: list[_Child] = []
        self._polled_s = time.monotonic()

    def say(self, name: str, line: str) -> None:
        """Write one log line."""
        with self._log_lock:
            self._log.write(f"{time.strftime('%H:%M:%S')} {name:<12}| {line}\n")
            self._log.flush()

    def start(self, name: str, arguments: Sequence[str]) -> None:
        """Start ``slipstream ARGUMENTS`` under a name."""
        notifications = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        notifications.setblocking(False)
        # Linux names it, by no file: nothing is left behind, and no path is too long.
        notifications.bind("")
        command = (sys.executable, "-m", "slipstream_cli", *arguments)
        child = _Child(name, command, notifications)
        self._children.append(child)
        self._spawn(child)

    def pids(self) -> Mapping[str, int]:
        """Process ids of what runs now, by name."""
        return {c.name: c.process.pid for c in self._children if c.process is not None}

    def poll(self) -> None:
        """End children that are silent for too long; restart what has ended, up to a limit."""
        now = time.monotonic()
        step_s = min(now - self._polled_s, _MAX_STEP_S)
        self._polled_s = now
        for child in self._children:
            process = child.process
            if process is not None and process.poll() is None:
                self._watch(child, process, step_s)
            if process is not None and process.poll() is not None:
                self._ended(child, process.returncode, now)
            if child.process is None and not child.given_up and now >= child.due_s:
                self.restarted += 1
                self._spawn(child)

    def _watch(self, child: _Child, process: subprocess.Popen[str], step_s: float) -> None:
        """Count the time without a notification; end the child where it becomes too long."""
        if _has_reported(child):
            child.silent_s = 0.0
            return
        child.silent_s += step_s
        limit_s = WATCHDOG_S if child.ready else _START_LIMIT_S
        if child.silent_s > limit_s:
            child.silent_s = 0.0
            what = "no progress" if child.ready else "not ready"
            self.say(child.name, f"{what} for {limit_s:g} s; killed")
            process.kill()

    def _ended(self, child: _Child, status: int, now: float) -> None:
        self._reap(child)
        if status == _EXIT_BAD_INPUT:
            child.given_up = True
            self.refused = child.name
            self.say(child.name, "refused its settings; not started again")
            return
        while child.restarts and child.restarts[0] < now - 60:
            child.restarts.popleft()
        if len(child.restarts) >= RESTARTS_A_MINUTE:
            child.given_up = True
            self.given_up.append(child.name)
            self.say(child.name, f"died {RESTARTS_A_MINUTE + 1} times in a minute; given up")
            return
        wait_s = _FIRST_WAIT_S * 2 ** len(child.restarts)
        child.restarts.append(now)
        child.due_s = now + wait_s
        self.say(child.name, f"ended with status {status}; started again in {wait_s:g} s")

    def _spawn(self, child: _Child) -> None:
        _has_reported(child)  # what the process before it has left
        child.ready, child.silent_s = False, 0.0
        # A session of its own keeps Ctrl-C on the terminal from reaching it before we ask it.
        child.process = subprocess.Popen(
            child.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            bufsize=1,
            start_new_session=True,
            env=os.environ
            | {
                SUPERVISED: str(os.getpid()),
                "PYTHONUNBUFFERED": "1",
                "NOTIFY_SOCKET": "@" + child.notifications.getsockname()[1:].decode(),
                "WATCHDOG_USEC": str(int(1e6 * WATCHDOG_S)),
            },
        )
        child.printer = threading.Thread(
            target=self._print, args=(child.name, child.process), daemon=True
        )
        child.printer.start()

    def _print(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            for text in readable(line.rstrip()):
                self.say(name, text)

    def _reap(self, child: _Child) -> None:
        """Forget a process that has ended, and end what it may have left in its session."""
        process = child.process
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if child.printer is not None:
            child.printer.join(timeout=1.0)
        if process.stdout is not None:
            process.stdout.close()
        child.process = None

    def stop(self) -> None:
        """Stop all by SIGTERM, and after 7 s by SIGKILL."""
        for child in self._children:
            child.given_up = True
            if child.process is not None and child.process.poll() is None:
                child.process.terminate()
        deadline = time.monotonic() + _STOP_S
        for child in self._children:
            if child.process is not None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.process.wait(timeout=max(0.0, deadline - time.monotonic()))
                if child.process.poll() is None:
                    self.say(child.name, "does not stop; killed")
            self._reap(child)
            child.notifications.close()


def _has_reported(child: _Child) -> bool:
    """Whether notifications have come since the last call; `ready` is set by READY=1."""
    reported = False
    with contextlib.suppress(BlockingIOError):
        while words := child.notifications.recv(4096).split(b"\n"):
            reported = True
            child.ready = child.ready or b"READY=1" in words
    return reported
