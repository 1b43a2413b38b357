"""`slipstream status`: what runs on this machine and how it is, worst first."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final

from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.freshness import STALE_AFTER_S

if TYPE_CHECKING:
    from slipstream.messages import DispatcherHealth, RsuHealth
    from slipstream_cli.running import Running

_SILENT_AFTER_S: Final = 30.0
"""Age above which a dispatcher counts as silent, as on the page."""
_ON_BUS: Final = ("dashboard", "dispatcher", "agent", "edge")
"""Daemons that need a router; those that may hear all come first."""


@dataclass(frozen=True)
class Finding:
    """One thing and how it is."""

    name: str
    well: bool
    text: str


@dataclass
class Heard:
    """What came over the bus.

    Attributes:
        connected: a router has answered.
        rsus: the latest health of each.
        dispatcher: its latest health.
        unreadable: what is wrong with a message, by its key.
    """

    connected: bool = False
    rsus: dict[str, RsuHealth] = field(default_factory=dict)
    dispatcher: DispatcherHealth | None = None
    unreadable: dict[str, str] = field(default_factory=dict)


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "status",
        help="what runs on this machine and how it is",
        description="Looks for daemons among the processes and systemd's units, asks their health "
        "endpoints, and listens to the bus. One line each, faults first; the exit status is 1 if "
        "something is wrong.",
    )
    command.add_argument(
        "--bus",
        metavar="ENDPOINT",
        help="router to listen to (default: that of the daemons found, or tcp/127.0.0.1:7447)",
    )
    command.add_argument("--seconds", type=float, default=3.0, help="time to listen to the bus")
    command.add_argument("--json", action="store_true", help="print one JSON object")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Look, ask, listen, and tell."""
    from slipstream_cli.running import processes, units

    if not 0.1 <= options.seconds <= 600.0:
        raise InputError("--seconds", f"{options.seconds:g} is out of range", "give 0.1 to 600")
    running, known_units = processes(), [*units()]
    bus = _bus(running, options.bus)
    heard = listen(bus, options.seconds)
    # A second site on this machine has a bus of its own.
    beside = [r.settings for r in running if _endpoints(r.settings) == bus.connect]
    expected = {rsu for settings in beside for rsu in getattr(settings, "rsus", None) or ()}
    now_ns = time.time_ns()
    needs_bus = any(r.command in _ON_BUS for r in running) or options.bus is not None
    findings = [
        *(_of_process(daemon) for daemon in running),
        *of_units(known_units),
        *of_bus(heard, bus, expected, now_ns, needed=needs_bus),
    ]
    if not findings:
        findings = [Finding("slipstream", False, "nothing of it runs on this machine")]
    findings.sort(key=lambda finding: finding.well)
    well = all(finding.well for finding in findings)
    if options.json:
        print(json.dumps({"well": well, "findings": [asdict(f) for f in findings]}))
    else:
        width = max(len(finding.name) for finding in findings)
        for finding in findings:
            state = "ok   " if finding.well else "FAULT"
            print(f"{state}  {finding.name:<{width}}  {finding.text}")
    return 0 if well else 1


def _bus(running: Sequence[Running], endpoint: str | None) -> BusSettings:
    """Of the daemons that run; those that may hear all first."""
    if endpoint is not None:
        return BusSettings(connect=(endpoint,))
    known = [r for r in running if r.command in _ON_BUS and r.settings is not None]
    known.sort(key=lambda daemon: _ON_BUS.index(daemon.command))
    return next((r.settings.bus for r in known), BusSettings())


def _endpoints(settings: Any) -> tuple[str, ...] | None:
    bus = getattr(settings, "bus", None)
    return None if bus is None else bus.connect


def listen(settings: BusSettings, seconds: float) -> Heard:
    """What RSUs and the dispatcher say of themselves within some seconds."""
    from slipstream.bus import Bus
    from slipstream.messages import (
        ALL_RSU_HEALTH,
        DISPATCHER_HEALTH_KEY,
        DispatcherHealth,
        RsuHealth,
        decode,
    )

    heard = Heard()

    def on_rsu(key: str, payload: bytes) -> None:
        try:
            health = decode(RsuHealth, payload, key)
        except InputError as error:
            heard.unreadable[key] = f"{error.problem}; {error.mend}"
        else:
            heard.rsus[health.rsu] = health

    def on_dispatcher(key: str, payload: bytes) -> None:
        try:
            heard.dispatcher = decode(DispatcherHealth, payload, key)
        except InputError as error:
            heard.unreadable[key] = f"{error.problem}; {error.mend}"

    try:
        with Bus.open(settings) as bus:
            bus.subscribe(ALL_RSU_HEALTH, on_rsu)
            bus.subscribe(DISPATCHER_HEALTH_KEY, on_dispatcher)
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                heard.connected = heard.connected or bus.is_connected
                time.sleep(0.05)
    except InputError:
        # Its password or certificate may be for the daemon alone.
        return heard
    return heard


def _of_process(daemon: Running) -> Finding:
    """How a daemon answers."""
    from slipstream_cli.running import ask

    name = daemon.command if daemon.config is None else f"{daemon.command} {daemon.config.stem}"
    since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(daemon.started_s))
    text = f"process {daemon.pid} since {since}"
    if daemon.config is not None and daemon.settings is None:
        return Finding(name, True, f"{text}; its settings cannot be read, so it was not asked")
    for what, address in _addresses(daemon):
        answer = ask(address)
        if answer is None:
            return Finding(name, False, f"{text}; {what}: no answer at {address}")
        status, line = answer
        if status >= 400:
            return Finding(name, False, f"{text}; {what}: HTTP {status}, {line}")
        text += f"; {what}: HTTP {status}"
    return Finding(name, True, text)


def _addresses(daemon: Running) -> Iterator[tuple[str, str]]:
    """What to ask a daemon, by its settings."""
    settings: Any = daemon.settings
    service = getattr(settings, "service", None)
    if service is not None and service.metrics_port:
        yield "health", f"http://127.0.0.1:{service.metrics_port}/healthz"
    if daemon.command == "dispatcher" and settings is not None and settings.api.port:
        yield "API", f"http://127.0.0.1:{settings.api.port}/readyz"
    if daemon.command == "dashboard" and settings is not None:
        host = "127.0.0.1" if settings.host in ("0.0.0.0", "::") else settings.host
        yield "page", f"http://{f'[{host}]' if ':' in host else host}:{settings.port}/"


def of_units(units: Sequence[Mapping[str, str]]) -> Iterator[Finding]:
    """systemd's view; units that nobody has enabled or started are left out."""
    for unit in units:
        state = f"{unit.get('ActiveState')} ({unit.get('SubState')})"
        if unit.get("ActiveState") == "active":
            yield Finding(unit["Id"], True, state)
        elif unit.get("ActiveState") != "inactive" or unit.get("UnitFileState") == "enabled":
            yield Finding(unit["Id"], False, f"{state}, result {unit.get('Result')}")


def of_bus(
    heard: Heard, bus: BusSettings, expected: set[str], now_ns: int, *, needed: bool
) -> Iterator[Finding]:
    """How RSUs and the dispatcher say they are.

    Args:
        heard: from them.
        bus: over which.
        expected: RSUs that the daemons of this machine know.
        now_ns: UTC.
        needed: a daemon runs here that needs a router.
    """
    from slipstream.messages import rsu_health_key

    where = ", ".join(bus.connect) if bus.config_file is None else str(bus.config_file)
    if not heard.connected:
        if needed:
            yield Finding("bus", False, f"no router answers at {where}")
        return
    yield Finding("bus", True, f"connected to {where}")
    for key, problem in sorted(heard.unreadable.items()):
        yield Finding(key, False, problem)
    unreadable = {rsu for rsu in expected if rsu_health_key(rsu) in heard.unreadable}
    for rsu in sorted((expected | heard.rsus.keys()) - unreadable):
        yield _of_rsu(rsu, heard.rsus.get(rsu), now_ns)
    health = heard.dispatcher
    if health is None:
        return
    age_s = 1e-9 * (now_ns - health.time_ns)
    text = (
        f"{health.cycles} cycles, {health.cycles_failed} failed; {health.vehicles_reporting} "
        f"vehicles report, {health.vehicles_silent} of them silent; "
        f"{health.messages_lost} messages lost; {health.rss_mb:.0f} MB"
    )
    if age_s > _SILENT_AFTER_S:
        yield Finding("dispatcher (bus)", False, f"silent for {age_s:.0f} s; {text}")
    elif health.database_set_aside is not None:
        text = f"started with a new database; the damaged one is {health.database_set_aside}"
        yield Finding("dispatcher (bus)", False, text)
    elif health.paused:
        yield Finding("dispatcher (bus)", False, f"paused: no cycle runs; {text}")
    else:
        yield Finding("dispatcher (bus)", True, text)


def _of_rsu(rsu: str, health: RsuHealth | None, now_ns: int) -> Finding:
    name = f"RSU {rsu}"
    if health is None:
        return Finding(name, False, "nothing heard of it")
    age_s = 1e-9 * (now_ns - health.time_ns)
    text = f"{health.fps:.1f} frames/s, {health.rss_mb:.0f} MB"
    if health.latency_ms_p95 is not None:
        text += f", latency {health.latency_ms_p95:.0f} ms (p95)"
    if age_s > STALE_AFTER_S:
        return Finding(name, False, f"silent for {age_s:.0f} s")
    if health.status != "ok":
        words = {"no_signal": "no signal from its camera", "ended": "its clip has ended"}
        return Finding(name, False, words[health.status])
    if health.fault is not None:
        return Finding(name, False, f"camera fault: {health.fault.replace('_', ' ')}; {text}")
    return Finding(name, True, text)
