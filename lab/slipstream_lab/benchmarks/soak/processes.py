"""Samples of a process and all its descendants, under names that outlive a restart."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path, PurePath

import psutil

_STARTING_S = 1.0
_NAMING = ("--rsu", "--name")
_ANONYMOUS = ("RssAnon", "VmSwap")
_SERVER = "forkserver"


@dataclass(frozen=True)
class ProcessSample:
    """One process at one moment.

    Attributes:
        name: the daemon's, as in its settings file; ``dispatcher/worker-1`` and the like for the
            processes that a daemon starts.
        memory_mb: anonymous memory, resident or swapped out: heaps and stacks. Pages of files
            (libraries, weights, clips) are left out: the kernel loads and drops them as it has
            room, by tens of MB, and what a program leaks is never among them.
        cpu_share: of one core, since the last sample; 0 in the first.
    """

    at_s: float
    name: str
    pid: int
    rss_mb: float
    memory_mb: float
    descriptors: int
    threads: int
    cpu_share: float


class ProcessTree:
    """Watches ``slipstream run`` and what it has started."""

    def __init__(self, pid: int) -> None:
        self._root = psutil.Process(pid)
        self._names: dict[int, str] = {pid: "supervisor"}
        self._cpu: dict[int, tuple[float, float]] = {}

    def sample(self, at_s: float) -> list[ProcessSample]:
        """All processes of the tree as they are now; none if it has ended."""
        try:
            processes = [self._root, *self._root.children(recursive=True)]
        except psutil.NoSuchProcess:
            return []
        alive = {process.pid for process in processes}
        samples = []
        # Parents and elder siblings first, so that names are given in the order of birth.
        for process in sorted(processes, key=lambda p: p.pid):
            try:
                name = self._name(process, alive)
                if name is not None:
                    samples.append(self._look(process, name, at_s))
            except (psutil.NoSuchProcess, psutil.ZombieProcess, psutil.AccessDenied):
                continue
        return samples

    def _look(self, process: psutil.Process, name: str, at_s: float) -> ProcessSample:
        with process.oneshot():
            times = process.cpu_times()
            used, now = times.user + times.system, time.monotonic()
            used_before, before = self._cpu.get(process.pid, (used, now - 1.0))
            self._cpu[process.pid] = (used, now)
            return ProcessSample(
                at_s=at_s,
                name=name,
                pid=process.pid,
                rss_mb=process.memory_info().rss / 1e6,
                memory_mb=_anonymous_mb(process.pid),
                descriptors=process.num_fds(),
                threads=process.num_threads(),
                cpu_share=max(0.0, (used - used_before) / max(now - before, 1e-3)),
            )

    def _name(self, process: psutil.Process, alive: set[int]) -> str | None:
        """The name of a process; None while it is still starting."""
        if process.pid in self._names:
            return self._names[process.pid]
        command = process.cmdline()
        if not command or process.status() == psutil.STATUS_ZOMBIE:
            return None
        if process.create_time() > time.time() - _STARTING_S and command == _parents(process):
            return None  # a fork that has not become another program yet
        if "--config" in command[:-1]:
            # An RSU and agents by their names, others by their sub-commands.
            at = command.index("--config")
            named = next((command.index(o) + 1 for o in _NAMING if o in command[:-1]), at - 1)
            name = command[named]
        else:
            parent = self._names.get(process.ppid())
            if parent is None:
                return None
            kind = _kind(command)
            if f"/{_SERVER}-" in parent:
                # What it forks has its command line, and works for the process that started it.
                parent, kind = parent.rpartition("/")[0], "worker"
            name = self._free(f"{parent}/{kind}", alive)
        self._names[process.pid] = name
        return name

    def _free(self, stem: str, alive: set[int]) -> str:
        """The first numbered name that no living process has: a successor inherits it."""
        taken = {name for pid, name in self._names.items() if pid in alive}
        number = 1
        while f"{stem}-{number}" in taken:
            number += 1
        return f"{stem}-{number}"


def _anonymous_mb(pid: int) -> float:
    """By the kernel's own counters, which cost next to nothing; smaps would walk all pages."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        raise psutil.NoSuchProcess(pid) from None
    fields = dict(line.split(":", 1) for line in lines)
    return sum(int(fields.get(name, "0 kB").split()[0]) for name in _ANONYMOUS) * 1024 / 1e6


def _parents(process: psutil.Process) -> list[str]:
    parent = process.parent()
    return [] if parent is None else parent.cmdline()


def _kind(command: list[str]) -> str:
    line = " ".join(command)
    if "resource_tracker" in line:
        return "tracker"
    if _SERVER in line:
        return _SERVER
    return "worker" if "spawn_main" in line else PurePath(command[0]).name
