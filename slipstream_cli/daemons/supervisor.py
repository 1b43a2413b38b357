"""Process supervisor of one machine's daemons: start, prefix logs, restart, stop."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, TextIO

from slipstream.service import SUPERVISED

RESTARTS_A_MINUTE: Final = 5
_FIRST_WAIT_S: Final = 0.5
_STOP_S: Final = 7.0
_EXIT_BAD_INPUT: Final = 2


@dataclass
class _Child:
    name: str
    command: Sequence[str]
    process: subprocess.Popen[str] | None = None
    printer: threading.Thread | None = None
    restarts: deque[float] = field(default_factory=deque)
    due_s: float = 0.0
    given_up: bool = False


class Supervisor:
    """Child processes, each with a name; call `poll` about ten times a second.

    Attributes:
        restarted: how often a process was started again.
        refused: name of a process that ended for bad input and so is not started again.
        given_up: names of processes that ended too often.
    """

    def __init__(self, log: TextIO) -> None:
        self.restarted = 0
        self.refused: str | None = None
        self.given_up: list[str] = []
        self._log = log
        self._log_lock = threading.Lock()
        self._children: list[_Child] = []

    def say(self, name: str, line: str) -> None:
        """Write one log line."""
        with self._log_lock:
            self._log.write(f"{time.strftime('%H:%M:%S')} {name:<12}| {line}\n")
            self._log.flush()

    def start(self, name: str, arguments: Sequence[str]) -> None:
        """Start ``slipstream ARGUMENTS`` under a name."""
        child = _Child(name, (sys.executable, "-m", "slipstream_cli", *arguments))
        self._children.append(child)
        self._spawn(child)

    def pids(self) -> Mapping[str, int]:
        """Process ids of what runs now, by name."""
        return {c.name: c.process.pid for c in self._children if c.process is not None}

    def poll(self) -> None:
        """Restart children that have ended, up to a limit."""
        now = time.monotonic()
        for child in self._children:
            process = child.process
            if process is not None and process.poll() is not None:
                self._ended(child, process.returncode, now)
            if child.process is None and not child.given_up and now >= child.due_s:
                self.restarted += 1
                self._spawn(child)

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
            env=os.environ | {SUPERVISED: str(os.getpid()), "PYTHONUNBUFFERED": "1"},
        )
        child.printer = threading.Thread(
            target=self._print, args=(child.name, child.process), daemon=True
        )
        child.printer.start()

    def _print(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self.say(name, line.rstrip())

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
