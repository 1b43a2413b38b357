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
    from slipstream.messages import Alarm, DispatcherHealth, RsuHealth
    from slipstream_cli.running import Running

_SILENT_AFTER_S: Final = 30.0
"""Age above which a dispatcher counts as silent, as on the page."""
_ON_BUS: Final = ("dashboard", "dispatcher", "agent", "edge")
"""Daemons that need a router; those that may hear all come first."""
_ORDER: Final = (False, None, True)
_STATES: Final = {False: "FAULT", None: "unknown", True: "ok"}


@dataclass(frozen=True)
class Finding:
    """One thing and how it is.

    Attributes:
        name: of the thing.
        well: None: it cannot be known.
        text: how it is, or what has to be done to know it.
    """

    name: str
    well: bool | None
    text: str


@dataclass
class BusHeard:
    """What came over the bus.

    Attributes:
        connected: a router has answered.
        rsus: the latest health of each.
        dispatcher: its latest health.
        alarms: that it tells of.
        unreadable: what is wrong with a message, by its key.
        fault: why none has, in words.
        refused: a router is there, and does not let this in.
        unasked: why no router could be asked; None: one was.
    """

    connected: bool = False
    rsus: dict[str, RsuHealth] = field(default_factory=dict)
    dispatcher: DispatcherHealth | None = None
    alarms: tuple[Alarm, ...] = ()
    unreadable: dict[str, str] = field(default_factory=dict)
    fault: str = "no router answers"
    refused: bool = False
    unasked: InputError | None = None


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "status",
        help="what runs on this machine and how it is",
        description="Looks for daemons among the processes and systemd's units, asks their health "
        "endpoints, and listens to the bus. One line each, faults first, then what cannot be "
        "known; the exit status is 1 if something is wrong or not known.",
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
    of_daemon, bus = _bus(running, options.bus)
    heard = listen(bus, options.seconds)
    # A second site on this machine has a bus of its own.
    beside = [r for r in running if r.bus is not None and r.bus.connect == bus.connect]
    expected = {rsu for r in beside for rsu in getattr(r.settings, "rsus", None) or ()}
    now_ns = time.time_ns()
    findings = [
        *(_of_process(daemon) for daemon in running),
        *of_units(known_units),
        *of_bus(
            heard,
            bus,
            expected,
            now_ns,
            needed=options.bus is not None or any(r.command in _ON_BUS for r in running),
            has_dispatcher=any(r.command == "dispatcher" for r in beside),
            certain=of_daemon or (options.bus is not None and not heard.refused),
        ),
    ]
    if not findings:
        findings = [Finding("slipstream", False, "nothing of it runs on this machine")]
    findings.sort(key=lambda finding: _ORDER.index(finding.well))
    well = findings[0].well
    if options.json:
        print(json.dumps({"well": well, "findings": [asdict(f) for f in findings]}))
    else:
        width = max(len(finding.name) for finding in findings)
        states = max(5, *(len(_STATES[finding.well]) for finding in findings))
        for finding in findings:
            print(f"{_STATES[finding.well]:<{states}}  {finding.name:<{width}}  {finding.text}")
    return 0 if well else 1


def _bus(running: Sequence[Running], endpoint: str | None) -> tuple[bool, BusSettings]:
    """Of the daemons that run, at an endpoint if one is asked for; those that may hear all first.

    Returns:
        (whether a daemon has it, the bus).
    """
    known = [(r.command, r.bus) for r in running if r.command in _ON_BUS and r.bus is not None]
    known.sort(key=lambda found: _ON_BUS.index(found[0]))
    for _, bus in known:
        at_endpoint = bus is not None and bus.config_file is None and endpoint in bus.connect
        if bus is not None and (endpoint is None or at_endpoint):
            return True, bus
    return False, BusSettings() if endpoint is None else BusSettings(connect=(endpoint,))


def listen(settings: BusSettings, seconds: float) -> BusHeard:
    """What RSUs and the dispatcher say of themselves within some seconds."""
    from slipstream.bus import Bus
    from slipstream.bus.routers import listening, why_unconnected
    from slipstream.messages import (
        ALARMS_KEY,
        ALL_RSU_HEALTH,
        DISPATCHER_HEALTH_KEY,
        Alarms,
        DispatcherHealth,
        RsuHealth,
        decode,
    )

    heard = BusHeard()

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

    def on_alarms(key: str, payload: bytes) -> None:
        try:
            heard.alarms = decode(Alarms, payload, key).alarms
        except InputError as error:
            heard.unreadable[key] = f"{error.problem}; {error.mend}"

    try:
        with Bus.open(settings) as bus:
            bus.subscribe(ALL_RSU_HEALTH, on_rsu)
            bus.subscribe(DISPATCHER_HEALTH_KEY, on_dispatcher)
            bus.subscribe(ALARMS_KEY, on_alarms)
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                heard.connected = heard.connected or bus.is_connected
                time.sleep(0.05)
            if not heard.connected:
                heard.fault = bus.fault() or heard.fault
                heard.refused = bool(listening(bus.endpoints))
    except InputError as error:
        # Its password or certificate may be for the daemon alone.
        if settings.config_file is None and not listening(settings.connect):
            heard.fault = why_unconnected(settings.connect)
        else:
            heard.unasked = error
    return heard


def _of_process(daemon: Running) -> Finding:
    """How a daemon answers."""
    from slipstream_cli.running import ask, router_fault

    name = daemon.command if daemon.name is None else f"{daemon.command} {daemon.name}"
    since = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(daemon.started_s))
    text = f"process {daemon.pid} since {since}"
    if daemon.unread is not None:
        return Finding(name, None, f"{text}; it was not asked, as {_as_root(daemon.unread)}")
    try:
        fault = router_fault(daemon) if daemon.command == "router" else None
    except InputError as error:
        return Finding(name, None, f"{text}; it was not asked, as {_as_root(error)}")
    if fault is not None:
        return Finding(name, False, f"{text}; {fault}")
    for what, address in _addresses(daemon):
        answer = ask(address)
        if answer is None:
            return Finding(name, False, f"{text}; {what}: no answer at {address}")
        status, line = answer
        if line == "standby":
            return Finding(name, True, f"{text}; standby")
        if status >= 400:
            return Finding(name, False, f"{text}; {what}: HTTP {status}, {line}")
        # Just after its start it may wait to hear others, and says so.
        awaited = line.removeprefix("ready; ") if line.startswith("ready; ") else None
        text += f"; {what}: HTTP {status}{f', {awaited}' if awaited else ''}"
    return Finding(name, True, text)


def _as_root(error: InputError) -> str:
    """Why a file cannot be read, and what to do about it."""
    return f"{error.source} cannot be read ({error.problem}); run it as root, who may read it"


def _addresses(daemon: Running) -> Iterator[tuple[str, str]]:
    """What to ask a daemon, by its settings."""
    settings: Any = daemon.settings
    service = getattr(settings, "service", None)
    if service is not None and service.metrics_port:
        yield "health", f"http://127.0.0.1:{service.metrics_port}/readyz"
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
    heard: BusHeard,
    bus: BusSettings,
    expected: set[str],
    now_ns: int,
    *,
    needed: bool,
    has_dispatcher: bool = False,
    certain: bool = True,
) -> Iterator[Finding]:
    """How RSUs and the dispatcher say they are.

    Args:
        expected: RSUs that the daemons of this machine know.
        needed: a daemon runs here that needs a router.
        has_dispatcher: one of this machine is on this bus.
        certain: that nothing connects is a fault; else the settings that say where the bus is and
            who may use it are not known.
    """
    from slipstream.messages import DISPATCHER_HEALTH_KEY, rsu_health_key

    where = ", ".join(bus.connect) if bus.config_file is None else str(bus.config_file)
    if not heard.connected:
        if not needed:
            return
        if heard.unasked is not None:
            yield Finding("bus", None, f"it was not asked, as {_as_root(heard.unasked)}")
        elif not certain:
            mend = "no daemon's settings could be read that say who may; run it as root"
            yield Finding("bus", None, f"{heard.fault}; {mend}")
        else:
            yield Finding("bus", False, heard.fault)
        return
    yield Finding("bus", True, f"connected to {where}")
    for key, problem in sorted(heard.unreadable.items()):
        yield Finding(key, False, problem)
    unreadable = {rsu for rsu in expected if rsu_health_key(rsu) in heard.unreadable}
    for rsu in sorted((expected | heard.rsus.keys()) - unreadable):
        yield _of_rsu(rsu, heard.rsus.get(rsu), now_ns)
    health = heard.dispatcher
    if health is None:
        if has_dispatcher and DISPATCHER_HEALTH_KEY not in heard.unreadable:
            yield Finding("dispatcher (bus)", False, "nothing heard of it")
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
    elif health.solver_fault is not None:
        yield Finding("dispatcher (bus)", False, f"{health.solver_fault}; {text}")
    elif health.paused:
        yield Finding("dispatcher (bus)", False, f"paused: no cycle runs; {text}")
    else:
        yield Finding("dispatcher (bus)", True, text)
    if age_s <= _SILENT_AFTER_S:
        for alarm in heard.alarms:
            if alarm.severity == "critical" and alarm.ended_ns is None:
                yield Finding(f"alarm {alarm.kind}", False, f"{alarm.text}; {alarm.mend}")


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
