"""A ``site.toml``: each daemon that it has a table of, and the files that it names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from slipstream.errors import InputError, refuse
from slipstream.site import Table, names_of, read_site, settings_of
from slipstream_cli.checks.kinds import Checked, check_fleet, check_tokens, lacking, network_of


def check_site(path: Path, network: str | None) -> Checked:
    """Check a file and what it names.

    Args:
        path: the file.
        network: its roads; None: those that it names.

    Raises:
        InputError: the first fault; its `others` are the further ones.
    """
    tables = read_site(path)
    network = network or network_named(tables)
    checks: dict[str, Callable[[Table, Path, str | None], Checked | None]] = {
        "rsus": _check_rsus,
        "dispatcher": _check_dispatcher,
        "dashboard": _check_dashboard,
        "scheduler": _check_scheduler,
        "worker": _check_worker,
    }
    faults: list[InputError] = []
    found: dict[str, Checked | None] = {}
    for table in checks.keys() & tables.keys():
        try:
            found[table] = checks[table](tables, path, network)
        except InputError as error:
            faults += (error, *error.others)
    served = found.get("dispatcher")
    known = None if served is None or served.fleet is None else served.fleet.vehicles
    vehicles = None if known is None else {vehicle.id for vehicle in known}
    faults += (*_agents(tables, path, vehicles), *_ports(tables, path))
    refuse(faults)
    if served is None:
        return Checked(path, "site")
    return Checked(path, "site", served.notes, served.unserved, served.fleet)


def network_named(tables: Table) -> str | None:
    """The roads of a file; None: it is a box's that has none."""
    uses = {"network", "dispatcher", "dashboard"} & tables.keys()
    return str(tables.get("network", "demo")) if uses else None


def _check_rsus(tables: Table, path: Path, network: str | None) -> None:
    """Segments of RSUs, then what runs here of them."""
    from slipstream.roads.admission import check_rsus

    faults: list[InputError] = []
    for name, own in tables["rsus"].items():
        try:
            if network is not None and "segments" in own:
                check_rsus({name: own["segments"]}, network_of(network), path)
            if name in names_of(tables, "edge"):
                _check_edge(tables, path, name, network)
        except InputError as error:
            faults += (error, *error.others)
    refuse(faults)


def _check_edge(tables: Table, path: Path, name: str, network: str | None) -> None:
    from edge_daemon.camera import load_camera
    from edge_daemon.detection import open_detector
    from edge_daemon.settings import EdgeSettings
    from edge_daemon.sources.clip import open_clip
    from edge_daemon.watch import read_reference

    settings = settings_of(tables, path, "edge", EdgeSettings, name)
    camera = load_camera(settings.camera)
    read_reference(camera)
    open_detector(settings.detector)
    if settings.source.clips:
        source = settings.source
        open_clip(*source.clips, loop=False, size=camera.size, fps=source.fps).close()
    listed = tables["rsus"][name].get("segments")
    refuse(
        (
            *(() if network is None else lacking(settings.camera, camera, network)),
            *(
                InputError(
                    settings.camera,
                    f"{path} does not list it for {name!r}",
                    f"add it to rsus.{name}.segments there, or remove it here",
                    key=f"segments.{segment.id}",
                )
                for segment in camera.segments
                if listed is not None and segment.id not in listed
            ),
        )
    )


def _check_dispatcher(tables: Table, path: Path, network: str | None) -> Checked:
    from dispatcher_daemon.settings import DispatcherSettings

    settings = settings_of(tables, path, "dispatcher", DispatcherSettings)
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


def _check_dashboard(tables: Table, path: Path, network: str | None) -> None:
    from dashboard.settings import DashboardSettings
    from dashboard.web.tables.fleet_file import make_scene

    settings = settings_of(tables, path, "dashboard", DashboardSettings)
    make_scene(network_of(network or settings.network), settings.fleet, settings.depots)


def _check_scheduler(tables: Table, path: Path, _: str | None) -> None:
    from dispatcher_daemon.settings import SchedulerSettings

    settings_of(tables, path, "scheduler", SchedulerSettings)


def _check_worker(tables: Table, path: Path, _: str | None) -> None:
    from dispatcher_daemon.settings import WorkerSettings

    settings_of(tables, path, "worker", WorkerSettings)


def _agents(tables: Table, path: Path, known: Iterable[str] | None) -> Iterator[InputError]:
    """Faults of agents, vehicles with two of them, and those that the fleet lacks."""
    from vehicle_agent.settings import AgentSettings

    seen: dict[str, str] = {}
    for name in tables.get("agents", {}):
        try:
            settings = settings_of(tables, path, "agent", AgentSettings, name)
        except InputError as error:
            yield from (error, *error.others)
            continue
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
    for key, port in _ports_of(tables):
        if port in seen:
            problem = f"port {port} is taken by {seen[port]}"
            yield InputError(path, problem, "give each its own", key=key)
        seen.setdefault(port, key)


def _ports_of(tables: Table) -> Iterator[tuple[str, int]]:
    rsus = names_of(tables, "edge")
    at = tables.get("edge", {}).get("metrics_port")
    own = {
        **{f"rsus.{name}": {"metrics_port": at, **tables["rsus"][name]} for name in rsus},
        **{f"agents.{name}": table for name, table in tables.get("agents", {}).items()},
        **{name: tables.get(name, {}) for name in ("dispatcher", "dashboard", "worker")},
        "dispatcher.api": tables.get("dispatcher", {}).get("api", {}),
        "scheduler": tables.get("scheduler", {}),
    }
    if "dashboard" in tables:
        own["dashboard"] = {"port": 8080, "scene_port": 8081, **own["dashboard"]}
    for table, values in own.items():
        for key in ("port", "scene_port", "metrics_port"):
            port = values.get(key) if isinstance(values, Mapping) else None
            if isinstance(port, int) and port:
                yield f"{table}.{key}", port
