"""Daemons as processes, started again as their shipped units say it."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream.service import die_with_parent

_UNITS: Final = Path(__file__).parents[4] / "deploy" / "systemd"
_POLL_S: Final = 0.02
_STOP_S: Final = 15.0
_BAD_INPUT: Final = 2
"""RestartPreventExitStatus= of all units."""


@dataclass
class _Unit:
    command: Sequence[str]
    environment: Mapping[str, str]
    restart_s: float
    log: Path
    process: subprocess.Popen[bytes] | None = None
    due_s: float = 0.0
    wanted: bool = True
    ended: list[int] = field(default_factory=list)


class Units:
    """A context manager. `unwanted`: ends that no fault of ours has caused."""

    def __init__(self, folder: Path) -> None:
        self.unwanted: list[str] = []
        self._folder, self._units = folder, dict[str, _Unit]()
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._blamed: set[str] = set()

    def add(
        self,
        name: str,
        unit: str,
        command: Sequence[str],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        """Start a daemon. `unit`: the file whose delay before a restart it has."""
        log = self._folder / f"{name}.log"
        log.unlink(missing_ok=True)
        one = _Unit(command, environment or {}, restart_delay_s(_UNITS / unit), log)
        with self._lock:
            self._units[name] = one
            self._spawn(one)

    def pid(self, name: str) -> int | None:
        """Its process; None: none runs now."""
        with self._lock:
            process = self._units[name].process
            return None if process is None else process.pid

    def signal(self, name: str, number: int) -> None:
        """Send a signal; of an end that follows the fault is the cause."""
        with self._lock:
            self._blamed.add(name)
            process = self._units[name].process
            if process is not None:
                with contextlib.suppress(ProcessLookupError):
                    process.send_signal(number)

    def stop(self, name: str) -> None:
        """As `systemctl stop`: in order, and by force where that takes too long."""
        with self._lock:
            unit = self._units[name]
            unit.wanted = False
            process = unit.process
        if process is not None:
            process.terminate()
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                self.unwanted.append(f"{name} did not stop within {_STOP_S:g} s")
        with self._lock:
            unit.process = None

    def start(self, name: str) -> None:
        """As `systemctl start`."""
        with self._lock:
            unit = self._units[name]
            unit.wanted = True
            if unit.process is None:
                self._spawn(unit)

    def excuse(self, *names: str) -> None:
        """From now on their ends are the fault's; without names each end counts again."""
        with self._lock:
            self._blamed = set(names)

    def __enter__(self) -> Units:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        # In the reverse order, so that none reports that its router is gone.
        for name in reversed(self._units):
            self.signal(name, signal.SIGCONT)
            self.stop(name)

    def _watch(self) -> None:
        while not self._ended.wait(_POLL_S):
            with self._lock:
                for name, unit in self._units.items():
                    self._look(name, unit, time.monotonic())

    def _look(self, name: str, unit: _Unit, now_s: float) -> None:
        if not unit.wanted:
            return
        if unit.process is None:
            if now_s >= unit.due_s:
                self._spawn(unit)
            return
        status = unit.process.poll()
        if status is None:
            return
        unit.process, unit.due_s = None, now_s + unit.restart_s
        if name not in self._blamed:
            self.unwanted.append(f"{name} ended with {status}")
        if status == _BAD_INPUT:
            unit.wanted = False
            self.unwanted.append(f"{name} ended with {status} and is not started again")

    def _spawn(self, unit: _Unit) -> None:
        with unit.log.open("ab") as log:
            unit.process = subprocess.Popen(
                unit.command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **unit.environment},
                preexec_fn=partial(die_with_parent, os.getpid()),
            )


def restart_delay_s(path: Path) -> float:
    """`RestartSec=` of a unit's file, in seconds. Raises InputError: it says none."""
    found = re.search(r"^RestartSec=([\d.]+)(ms)?$", path.read_text(encoding="utf-8"), re.MULTILINE)
    if found is None:
        raise InputError(path, "no RestartSec=", "give one")
    return float(found[1]) / (1000 if found[2] else 1)
