"""A ``site.toml``: each daemon that it has a table of, and the files that it names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Final, TypeVar

from slipstream.errors import InputError, refuse
from slipstream.site import NAMED, Table, read_site, settings_of
from slipstream_cli.checks.kinds import Checked, check_fleet, check_tokens, lacking, network_of
from slipstream_cli.place.site_file import daemons_of

if TYPE_CHECKING:
    from dashboard.settings import DashboardSettings
    from dispatcher_daemon.settings import DispatcherSettings
    from edge_daemon.settings import EdgeSettings
    from vehicle_agent.settings import AgentSettings

T = TypeVar("T")

_MODELS: Final = {
    "edge": "edge_daemon.settings:EdgeSettings",
    "dispatcher": "dispatcher_daemon.settings:DispatcherSettings",
    "agent": "vehicle_agent.settings:AgentSettings",
    "dashboard": "dashboard.settings:DashboardSettings",
    "scheduler": "dispatcher_daemon.settings:SchedulerSettings",
    "worker": "dispatcher_daemon.settings:WorkerSettings",
}
"""Settings by sub-command; a box has the packages of its own daemon alone."""


def check_site(path: Path, network: str | None) -> Checked:
    """Check a file and what it names.

    Args:
        network: its roads; None: those that it names.

    Raises:
        InputError: the first fault; its `others` are the further ones.
    """
    tables = read_site(path)
    network = network or network_named(tables)
    faults: list[InputError] = []

    def tried(check: Callable[[], T]) -> T | None:
        try:
            return check()
        except InputError as error:
            faults.extend((error, *error.others))
            return None

    of_daemons: dict[tuple[str, str | None], Any] = {}
    for command, name in daemons_of(tables):
        model = resolve_name(_MODELS[command])
        settings: Any = tried(partial(settings_of, tables, path, command, model, name))
        if settings is not None:
            of_daemons[command, name] = settings
    rsus: Mapping[str, Table] = tables.get("rsus", {})
    tried(partial(_check_rsus, rsus, path, network))
    served: Checked | None = None
    for (command, name), settings in of_daemons.items():
        if command == "edge" and name is not None:
            listed = rsus[name].get("segments")
            tried(partial(_check_edge, settings, path, listed, network))
        elif command == "dispatcher":
            served = tried(partial(_check_dispatcher, settings, path, network))
        elif command == "dashboard":
            tried(partial(_check_dashboard, settings, network))
    agents = {name or "": s for (command, name), s in of_daemons.items() if command == "agent"}
    fleet = None if served is None else served.fleet
    faults += _agents(agents, None if fleet is None else {v.id for v in fleet.vehicles}, path)
    faults += _ports(tables, path)
    refuse(faults)
    if served is None:
        return Checked(path, "site")
    return Checked(path, "site", served.notes, served.unserved, served.fleet)


def network_named(tables: Table) -> str | None:
    """The roads of a file; None: it is a box's that has none."""
    uses = {"network", "dispatcher", "dashboard"} & tables.keys()
    return str(tables.get("network", "demo")) if uses else None


def _check_rsus(rsus: Mapping[str, Table], path: Path, network: str | None) -> None:
    listed = {name: own["segments"] for name, own in rsus.items() if "segments" in own}
    if network is not None and listed:
        from slipstream.roads.admission import check_rsus

        check_rsus(listed, network_of(network), path)


def _check_edge(
    settings: EdgeSettings, path: Path, listed: Sequence[str] | None, network: str | None
) -> None:
    from edge_daemon.camera import load_camera
    from edge_daemon.detection import open_detector
    from edge_daemon.sources.clip import open_clip
    from edge_daemon.watch import read_reference

    camera = load_camera(settings.camera)
    read_reference(camera)
    open_detector(settings.detector)
    if settings.source.clips:
        source = settings.source
        open_clip(*source.clips, loop=False, size=camera.size, fps=source.fps).close()
    refuse(
        (
            *(() if network is None else lacking(settings.camera, camera, network)),
            *(
                InputError(
                    settings.camera,
                    f"{path} does not list it for {settings.rsu!r}",
                    f"add it to rsus.{settings.rsu}.segments there, or remove it here",
                    key=f"segments.{segment.id}",
                )
                for segment in camera.segments
                if listed is not None and segment.id not in listed
            ),
        )
    )


def _check_dispatcher(settings: DispatcherSettings, path: Path, network: str | None) -> Checked:
    service, _, device = settings.hardware.backend.partition(":")
    if service == "fake":
        from dispatcher_daemon.solvers.quantum.backends import fake_target

        try:
            fake_target(device)
        except InputError as error:
            key = "dispatcher.hardware.backend"
            raise InputError(path, error.problem, error.mend, key=key) from None
    tokens = settings.api.tokens
    if tokens is not None and tokens.name != str(tokens):
        # A plain name is mostly one of systemd's, which is not here.
        check_tokens(tokens, None)
    return check_fleet(Path(settings.fleet), network_of(network or settings.network))


def _check_dashboard(settings: DashboardSettings, network: str | None) -> None:
    from dashboard.web.tables.fleet_file import make_scene

    make_scene(network_of(network or settings.network), settings.fleet, settings.depots)


def _agents(
    agents: Mapping[str, AgentSettings], known: Collection[str] | None, path: Path
) -> Iterator[InputError]:
    """Vehicles with two agents, and those that the fleet lacks."""
    seen: dict[str, str] = {}
    for name, settings in agents.items():
        for vehicle in settings.vehicles:
            key = f"agents.{name}.vehicles.{vehicle.id}"
            if vehicle.id in seen:
                problem = f"agents.{seen[vehicle.id]} has an agent of it too"
                yield InputError(path, problem, "remove it from one", key=key)
            seen.setdefault(vehicle.id, name)
            if known is not None and vehicle.id not in known:
                problem = "the fleet has no such vehicle"
                yield InputError(path, problem, "add it there, or mend its id", key=key)


def _ports(tables: Table, path: Path) -> Iterator[InputError]:
    """Ports that two daemons ask for, where the router is on their machine."""
    ends = tables.get("bus", {}).get("connect", ["tcp/127.0.0.1:7447"])
    if not any("/127." in end or "/localhost:" in end for end in ends):
        return
    seen: dict[int, str] = {}
    for key, port in ports_of(tables):
        if port in seen:
            problem = f"port {port} is taken by {seen[port]}"
            yield InputError(path, problem, "give each its own", key=key)
        seen.setdefault(port, key)


def ports_of(tables: Table) -> Iterator[tuple[str, int]]:
    """Key and port of each that a daemon of this machine listens on."""
    for command, name in daemons_of(tables):
        own = tables.get(command, {})
        table = command if name is None else f"{NAMED[command][0]}.{name}"
        if name is not None:
            own = {**own, **tables[NAMED[command][0]][name]}
        if command == "dashboard":
            fields = resolve_name(_MODELS[command]).model_fields
            own = {key: fields[key].default for key in ("port", "scene_port")} | own
        api = own.get("api") if command == "dispatcher" else None
        ports = {f"{table}.{key}": own.get(key) for key in ("port", "scene_port", "metrics_port")}
        ports[f"{table}.api.port"] = api.get("port") if isinstance(api, Mapping) else None
        for key, port in ports.items():
            if isinstance(port, int) and port:
                yield key, port
