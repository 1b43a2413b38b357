"""The site that faults are put into: real daemons, a town's vans, two cameras."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import tomli_w

from slipstream.bus import free_port
from slipstream.config import DEMO_NETWORK, BusSettings
from slipstream_cli.place.site_file import SiteSpec, write_site
from slipstream_lab.benchmarks.chaos import links
from slipstream_lab.benchmarks.chaos.camera import FaultyCamera
from slipstream_lab.benchmarks.chaos.faults import (
    AGENTS,
    CLIENTS,
    DASHBOARD,
    DISPATCHER,
    ON_CABLES,
    ROUTER,
    RSUS,
    WITH_FAKED_CLOCKS,
    Fault,
)
from slipstream_lab.benchmarks.chaos.units import Units
from slipstream_lab.commands.live.demo import ROADSIDES, agents, make_clips
from slipstream_lab.simulation.live.process import WorldProcess
from slipstream_lab.simulation.live.town import town

APART: Final = "SLIPSTREAM_CHAOS_APART"
"""In the environment of a run with namespaces of its own: mounts and cables are nobody else's."""
VANS: Final = 3
INTERVAL_S: Final = 2.0
"""Between two cycles: one has to end within the limit of a recovery."""
_NOT_APART: Final = "no namespaces of its own"
_DISK_BYTES: Final = 64 << 20
_FAKETIME: Final = Path("/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1")
_UNIT: Final[Mapping[str, str]] = {
    ROUTER: "slipstream-router.service",
    DISPATCHER: "slipstream-dispatcher.service",
    DASHBOARD: "slipstream-dashboard.service",
    AGENTS: "slipstream-agent@.service",
    **dict.fromkeys(RSUS, "slipstream-edge@.service"),
}


@dataclass
class Site:
    """A running site.

    Attributes:
        without: kinds of faults that this machine cannot have, and why.
        segments: what each RSU watches.
    """

    units: Units
    cameras: Mapping[str, FaultyCamera]
    links: Mapping[str, links.Link]
    world: WorldProcess
    disk: Path
    clocks: Mapping[str, Path]
    bus: BusSettings
    api: str
    page: str
    token: str
    without: Mapping[str, str]
    segments: Mapping[str, str] = field(
        default_factory=lambda: {one.rsu: one.segment for one in ROADSIDES}
    )

    @property
    def database(self) -> Path:
        """Of the dispatcher."""
        return self.disk / "slipstream.db"

    def begin(self, fault: Fault) -> None:
        """Inject a fault."""
        _BEGIN[fault.kind](self, fault)

    def end(self, fault: Fault) -> None:
        """Take it away again."""
        _END.get(fault.kind, _nothing)(self, fault)


@contextmanager
def open_site(folder: Path, clips: Path, say: Callable[[str], None]) -> Iterator[Site]:
    """Start all of it. Raises InputError: a clip, the town or a daemon's settings are of no use."""
    without: dict[str, str] = {}
    say("making the roadside clips (once, about a minute)")
    videos = make_clips(clips, threading.Event())
    with ExitStack() as stack:
        disk = _disk(folder / "disk", without, stack)
        router, address, ways = _ways(folder, stack, say)
        bus = BusSettings(connect=(links.endpoint(address),))
        spec = town(folder / "town", bus, vans=VANS)
        cameras = {
            one.rsu: FaultyCamera(videos[one.rsu]["stable"] / "video.mp4") for one in ROADSIDES
        }
        for camera in cameras.values():
            stack.callback(camera.close)
        ports = {"api": free_port(), "page": free_port()}
        token = secrets.token_urlsafe(32)
        _write_token(folder / "tokens.toml", token)
        clocks = _clocks(folder, without)
        place = _place(
            folder, disk, ports, str(spec.fleet.absolute()), agents(spec, folder / "tours")
        )
        rsus = {
            one.rsu: {
                "segments": [one.segment],
                "camera": str(videos[one.rsu]["stable"] / "camera.toml"),
                "source": {"url": cameras[one.rsu].url},
            }
            for one in ROADSIDES
        }
        units = stack.enter_context(Units(folder))
        units.add(ROUTER, _UNIT[ROUTER], router)
        for name in CLIENTS:
            own = replace(place, endpoint=links.endpoint(ways[name].address), rsus=rsus)
            words = write_site(folder / f"{name}.toml", own)[name]
            command = [sys.executable, "-m", "slipstream_cli", *words]
            environment = _faked(clocks[name]) if name in clocks else {}
            units.add(name, _UNIT[name], command, environment)
        world = stack.enter_context(WorldProcess(spec))
        world.open(lambda: False, lambda share: None)
        api, page = (f"http://127.0.0.1:{ports[one]}" for one in ("api", "page"))
        yield Site(units, cameras, ways, world, disk, clocks, bus, api, page, token, without)


def _place(
    folder: Path, disk: Path, ports: Mapping[str, int], fleet: str, vans: dict[str, object]
) -> SiteSpec:
    return SiteSpec(
        network=DEMO_NETWORK,
        fleet=fleet,
        database=disk / "slipstream.db",
        endpoint="",
        port=ports["page"],
        rsus={},
        agents={AGENTS: vans},
        edge={"detector": {"threads": 1}},
        dispatcher={
            "form": "route",
            "solvers": ["exact"],
            "interval_s": INTERVAL_S,
            "deadline_s": INTERVAL_S / 2,
            "orders": {"bundle_s": 0.0},
            "api": {"port": ports["api"], "tokens": str((folder / "tokens.toml").absolute())},
        },
    )


def _write_token(path: Path, token: str) -> None:
    entry = {
        "name": "chaos",
        "sha256": hashlib.sha256(token.encode()).hexdigest(),
        "scopes": ["read", "orders"],
    }
    path.write_text(tomli_w.dumps({"tokens": [entry]}), encoding="utf-8")


def _disk(folder: Path, without: dict[str, str], stack: ExitStack) -> Path:
    """A small disk of its own, which can be full and read-only."""
    folder.mkdir(parents=True, exist_ok=True)
    if APART not in os.environ:
        without |= dict.fromkeys(("full disk", "read-only disk"), _NOT_APART)
        return folder
    done = _run("mount", "-t", "tmpfs", "-o", f"size={_DISK_BYTES}", "chaos", str(folder))
    if done is None:
        stack.callback(_run, "umount", "--lazy", str(folder))
    else:
        without |= dict.fromkeys(("full disk", "read-only disk"), f"no disk of its own: {done}")
        shutil.rmtree(folder)
        folder.mkdir()
    return folder


def _ways(
    folder: Path, stack: ExitStack, say: Callable[[str], None]
) -> tuple[list[str], tuple[str, int], dict[str, links.Link]]:
    """The router's command, where it is reached without a fault, and each daemon's way to it."""
    config = folder / "router.json5"
    router = [sys.executable, "-m", "slipstream_cli", "router", "--config", str(config)]
    why = links.open_namespace() if APART in os.environ else _NOT_APART
    ways: dict[str, links.Link] = {}
    if why is None:
        stack.callback(links.close_namespace)
        port = 7447
        for number, name in enumerate(("the laboratory", *ON_CABLES)):
            ways[name] = links.CableLink(number, port)
        address = ways.pop("the laboratory").address
        links.write_router(config, "0.0.0.0", port)
        router = ["ip", "netns", "exec", links.NAMESPACE, *router]
    else:
        say(f"every partition is a proxy's: {why}")
        address = "127.0.0.1", free_port()
        links.write_router(config, *address)
    for name in CLIENTS:
        if name not in ways:
            ways[name] = proxy = links.ProxyLink(address)
            stack.callback(proxy.close)
    return router, address, ways


def _clocks(folder: Path, without: dict[str, str]) -> dict[str, Path]:
    """A file for each daemon whose clock can be set, with what it is ahead by."""
    if not _FAKETIME.exists():
        without["clock"] = "libfaketime is not installed"
        return {}
    clocks = {name: folder / f"{name}.clock" for name in WITH_FAKED_CLOCKS}
    for path in clocks.values():
        path.write_text("+0\n")
    return clocks


def _faked(clock: Path) -> dict[str, str]:
    return {
        "LD_PRELOAD": str(_FAKETIME),
        "FAKETIME_TIMESTAMP_FILE": str(clock),
        "FAKETIME_CACHE_DURATION": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        "DONT_FAKE_MONOTONIC": "1",
    }


def _run(*words: str) -> str | None:
    """What a command complains of; None: nothing."""
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        return str(error)
    return None if done.returncode == 0 else done.stderr.strip()


def _nothing(_site: Site, _fault: Fault) -> None:
    """What ends by itself."""


def _kill(site: Site, fault: Fault) -> None:
    site.units.signal(fault.targets[0], signal.SIGKILL)


def _stop(site: Site, fault: Fault) -> None:
    site.units.signal(fault.targets[0], signal.SIGSTOP)


def _continue(site: Site, fault: Fault) -> None:
    site.units.signal(fault.targets[0], signal.SIGCONT)


def _cut(site: Site, fault: Fault) -> None:
    site.links[fault.targets[0]].cut()


def _mend(site: Site, fault: Fault) -> None:
    site.links[fault.targets[0]].mend()


def _delay(site: Site, fault: Fault) -> None:
    _proxy(site, fault).delay_s = float(fault.value or 0.0)


def _lose(site: Site, fault: Fault) -> None:
    _proxy(site, fault).loss = float(fault.value or 0.0)


def _proxy(site: Site, fault: Fault) -> links.ProxyLink:
    link = site.links[fault.targets[0]]
    assert isinstance(link, links.ProxyLink)
    return link


def _fill(site: Site, _fault: Fault) -> None:
    with (site.disk / "filled").open("wb") as file, contextlib.suppress(OSError):
        while True:
            file.write(bytes(1 << 20))
            file.flush()


def _empty(site: Site, _fault: Fault) -> None:
    (site.disk / "filled").unlink()


def _protect(site: Site, _fault: Fault) -> None:
    """What has a file of it open keeps a disk writable: both begin anew on it."""
    for name in (DISPATCHER, DASHBOARD):
        site.units.stop(name)
    why = _run("mount", "-o", "remount,ro", str(site.disk))
    if why is not None:
        raise RuntimeError(f"the disk does not become read-only: {why}")
    for name in (DISPATCHER, DASHBOARD):
        site.units.start(name)


def _unprotect(site: Site, _fault: Fault) -> None:
    why = _run("mount", "-o", "remount,rw", str(site.disk))
    if why is not None:
        raise RuntimeError(f"the disk stays read-only: {why}")


def _set_clock(site: Site, fault: Fault) -> None:
    _write_clock(site.clocks[fault.targets[0]], float(fault.value or 0.0))


def _reset_clock(site: Site, fault: Fault) -> None:
    _write_clock(site.clocks[fault.targets[0]], 0.0)


def _write_clock(path: Path, ahead_s: float) -> None:
    new = path.with_suffix(".new")
    new.write_text(f"{ahead_s:+g}\n")
    new.replace(path)


def _fail_camera(site: Site, fault: Fault) -> None:
    site.cameras[fault.targets[0]].fault = fault.value  # type: ignore[assignment]


def _heal_camera(site: Site, fault: Fault) -> None:
    site.cameras[fault.targets[0]].fault = None


def _restart(site: Site, fault: Fault) -> None:
    for name in fault.targets:
        site.units.stop(name)
    for name in fault.targets:
        site.units.start(name)


_Act = Callable[[Site, Fault], None]
_BEGIN: Final[Mapping[str, _Act]] = {
    "kill": _kill,
    "stop": _stop,
    "partition": _cut,
    "delay": _delay,
    "loss": _lose,
    "full disk": _fill,
    "read-only disk": _protect,
    "clock": _set_clock,
    "camera": _fail_camera,
    "restart": _restart,
}
_END: Final[Mapping[str, _Act]] = {
    "stop": _continue,
    "partition": _mend,
    "delay": _mend,
    "loss": _mend,
    "full disk": _empty,
    "read-only disk": _unprotect,
    "clock": _reset_clock,
    "camera": _heal_camera,
}
