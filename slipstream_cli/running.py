"""What of Slipstream runs on this machine: processes with their settings, systemd's units."""

from __future__ import annotations

import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import psutil

from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.site import NAMED, load_site

_DAEMONS: Final = (
    *("run", "world", "router", "edge", "dispatcher", "agent", "dashboard"),
    *("scheduler", "worker"),
)
_PROPERTIES: Final = ("Id", "LoadState", "ActiveState", "SubState", "Result", "UnitFileState")
_PROBE_S: Final = 2.0
_SYSTEMCTL_S: Final = 10.0
_LINK_S: Final = 1.0


@dataclass(frozen=True)
class Running:
    """A daemon's process.

    Attributes:
        command: sub-command.
        pid: process.
        started_s: UTC, s.
        config: its settings file; None: it has none.
        settings: read from it; None: it has none, or they cannot be read.
        unread: why they cannot be read; None: they are, or there are none.
        name: of the roadside unit or the agents; None: none is given.
    """

    command: str
    pid: int
    started_s: float
    config: Path | None
    settings: Any
    unread: InputError | None = None
    name: str | None = None

    @property
    def bus(self) -> BusSettings | None:
        """How it reaches the bus, with its files where it finds them; None: it is not known."""
        bus: BusSettings | None = getattr(self.settings, "bus", None)
        if bus is None:
            return None
        files = {name: getattr(bus, name) for name in ("config_file", "password_file")}
        seen = {name: _seen(self, path) for name, path in files.items() if path is not None}
        return bus.model_copy(update=seen)


def _seen(daemon: Running, path: Path) -> Path:
    """Where a daemon finds a file that its settings name.

    systemd hands a unit its passwords in a folder of its own, which is that of its settings too.
    """
    folders: list[Path] = []
    if not path.is_absolute():
        try:
            process = psutil.Process(daemon.pid)
            given = process.environ().get("CREDENTIALS_DIRECTORY")
            if given is not None and path.name == str(path):
                folders.append(Path(given))
            folders.append(Path(process.cwd()))
        except (psutil.Error, OSError):
            pass
        folders += [] if daemon.config is None else [daemon.config.parent]
    found = [folder / path for folder in folders]
    return next((file for file in found if file.exists()), found[0] if found else path)


def command_of(words: Sequence[str]) -> tuple[str, Sequence[str]] | None:
    """A daemon's sub-command and its options, from a process's command line; None: it is none."""
    for at, word in enumerate(words):
        name = Path(word).name
        if name == "router.py" and "slipstream" in word:
            return "router", ("--config", *words[at + 1 :])
        is_ours = name == "slipstream" or (name == "slipstream_cli" and words[at - 1] == "-m")
        if is_ours and at + 1 < len(words) and words[at + 1] in _DAEMONS:
            return words[at + 1], words[at + 2 :]
    return None


def processes() -> list[Running]:
    """All daemons of this machine, by their command lines; workers that they fork are left out."""
    from slipstream_cli.settings_doc import DAEMONS

    found: dict[int, tuple[psutil.Process, str, Sequence[str]]] = {}
    for process in psutil.process_iter(["pid", "cmdline", "ppid", "create_time"]):
        daemon = command_of(process.info["cmdline"] or ())
        if daemon is not None:
            found[process.pid] = (process, *daemon)
    running = []
    for process, command, options in found.values():
        parent = found.get(process.info["ppid"])
        if parent is not None and (parent[1], [*parent[2]]) == (command, [*options]):
            continue
        path = _config(process, options)
        name = _option(options, NAMED[command][1]) if command in NAMED else None
        settings, unread = None, None
        if path is not None and command in DAEMONS:
            try:
                settings = load_site(path, command, DAEMONS[command], name)
            except InputError as error:
                unread = error
        created = float(process.info["create_time"])
        running.append(Running(command, process.pid, created, path, settings, unread, name))
    return running


def router_fault(daemon: Running) -> str | None:
    """Why a router has no link to those that its configuration connects to; None: it has.

    A router that refuses another closes the connection within an instant: one that stays is a link.

    Raises:
        InputError: the configuration cannot be read.
    """
    from slipstream.bus.routers import endpoints_of, why_unconnected
    from slipstream.bus.zenoh_config import read_config

    endpoints = () if daemon.config is None else endpoints_of(read_config(daemon.config))
    if not endpoints:
        return None
    before = _connections(daemon.pid, endpoints)
    time.sleep(_LINK_S)
    return None if before & _connections(daemon.pid, endpoints) else why_unconnected(endpoints)


def _connections(pid: int, endpoints: Sequence[str]) -> set[tuple[int, int]]:
    """Own and other port of a process's connections to the ports of endpoints."""
    ports = {port for one in endpoints if (port := one.rpartition(":")[2]).isdecimal()}
    try:
        found = psutil.Process(pid).net_connections("tcp")
    except psutil.Error:
        return set()
    return {
        (one.laddr.port, one.raddr.port)
        for one in found
        if one.status == psutil.CONN_ESTABLISHED and str(one.raddr.port) in ports
    }


def _config(process: psutil.Process, options: Sequence[str]) -> Path | None:
    given = _option(options, "--config")
    path = None if given is None else Path(given)
    if path is None or path.is_absolute():
        return path
    try:
        return Path(process.cwd()) / path
    except (psutil.Error, OSError):
        return path


def _option(words: Sequence[str], option: str) -> str | None:
    value = None
    for at, word in enumerate(words):
        if word.startswith(f"{option}="):
            value = word.partition("=")[2]
        elif word == option and at + 1 < len(words):
            value = words[at + 1]
    return value


def units() -> Iterator[dict[str, str]]:
    """The properties of systemd's units of Slipstream; none where systemd does not run."""
    names = ",".join(_PROPERTIES)
    command = ["systemctl", "show", "--all", f"--property={names}", "slipstream-*"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_SYSTEMCTL_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return
    for block in done.stdout.split("\n\n") if done.returncode == 0 else ():
        unit = dict(line.split("=", 1) for line in block.splitlines() if "=" in line)
        if unit.get("Id", "").startswith("slipstream-"):
            yield unit


def ask(address: str) -> tuple[int, str] | None:
    """HTTP status and first line of a page of this machine; None: nobody answers."""
    # Past any proxy of the environment: it is this machine's own page.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(address, timeout=_PROBE_S) as answer:
            return int(answer.status), _line(answer.read(500))
    except urllib.error.HTTPError as error:
        return int(error.code), _line(error.read(500))
    except (OSError, ValueError):
        return None


def _line(text: bytes) -> str:
    return next(iter(text.decode(errors="replace").splitlines()), "")
