"""`slipstream check`: validate settings, fleet and instance files without starting anything."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from slipstream.config import load, read_data
from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream.roads import RoadNetwork


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("check", help="validate settings, fleets and instances")
    command.add_argument("config", type=Path, nargs="+", help="settings, fleet or instance")
    command.add_argument(
        "--as",
        dest="kind",
        choices=tuple(_CHECKS),
        help="what they are (default: told from the file's name or content)",
    )
    command.add_argument(
        "--network", default="demo", help="roads of a fleet file: a SUMO net (default: the demo's)"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check each file; stops at the first fault."""
    for path in options.config:
        kind = options.kind or _kind_of(path)
        unserved = _CHECKS[kind](path, options.network)
        what = kind if kind in ("fleet", "instance") else f"{kind} settings"
        print(f"{path}: valid {what}")
        for stop, reason in unserved.items():
            print(f"{path}: stop {stop} cannot be served: {reason}")
    return 0


def _kind_of(path: Path) -> str:
    content = read_data(path)
    keys = content.keys() if isinstance(content, dict) else ()
    for kind, wanted in (("instance", {"format"}), ("fleet", {"stops", "vehicles"})):
        if wanted <= set(keys):
            return kind
    for kind in _CHECKS:
        if kind in path.stem:
            return kind
    for kind, key in (
        ("edge", "rsu"),
        ("dispatcher", "fleet"),
        ("dashboard", "port"),
        ("agent", "vehicles"),
        ("worker", "processes"),
    ):
        if key in keys:
            return kind
    raise InputError(
        path,
        "cannot tell what it is",
        f"say so with --as, or put {', '.join(_CHECKS)} into its name",
    )


def _check_edge(path: Path, _: str) -> Mapping[str, str]:
    from edge_daemon.camera import load_camera
    from edge_daemon.detection import open_detector
    from edge_daemon.settings import EdgeSettings
    from edge_daemon.sources.clip import open_clip
    from edge_daemon.watch import read_reference

    settings = load(path, EdgeSettings)
    camera = load_camera(settings.camera)
    read_reference(camera)
    open_detector(settings.detector)
    if settings.source.clips:
        open_clip(*settings.source.clips, loop=False, size=camera.size).close()
    return {}


def _check_dispatcher(path: Path, _: str) -> Mapping[str, str]:
    from dispatcher_daemon.settings import DispatcherSettings
    from slipstream.admission import check_rsus
    from slipstream.sumo_net import load_network

    settings = load(path, DispatcherSettings)
    roads = load_network(settings.network)
    check_rsus(settings.rsus, roads, path)
    service, _, device = settings.hardware.backend.partition(":")
    if service == "fake":
        from dispatcher_daemon.solvers.quantum.backends.aer import fake_target

        try:
            fake_target(device)
        except InputError as error:
            raise InputError(path, error.problem, error.mend, key="hardware.backend") from None
    return _unservable(Path(settings.fleet), roads)


def _check_agent(path: Path, _: str) -> Mapping[str, str]:
    from vehicle_agent.settings import AgentSettings

    load(path, AgentSettings)
    return {}


def _check_dashboard(path: Path, _: str) -> Mapping[str, str]:
    from dashboard.settings import DashboardSettings
    from slipstream.admission import check_rsus
    from slipstream.sumo_net import load_network

    settings = load(path, DashboardSettings)
    check_rsus(settings.rsus, load_network(settings.network), path)
    return {}


def _check_scheduler(path: Path, _: str) -> Mapping[str, str]:
    from dispatcher_daemon.cluster_settings import SchedulerSettings

    load(path, SchedulerSettings)
    return {}


def _check_worker(path: Path, _: str) -> Mapping[str, str]:
    from dispatcher_daemon.cluster_settings import WorkerSettings

    load(path, WorkerSettings)
    return {}


def _check_fleet(path: Path, network: str) -> Mapping[str, str]:
    from slipstream.sumo_net import load_network

    return _unservable(path, load_network(network))


def _unservable(path: Path, roads: RoadNetwork) -> Mapping[str, str]:
    from dispatcher_daemon.fleet import distances
    from dispatcher_daemon.fleet_file import FleetFile
    from dispatcher_daemon.planning import unservable
    from dispatcher_daemon.problem import RoutingProblem
    from dispatcher_daemon.traffic import take_snapshot
    from slipstream.freshness import STALE_AFTER_S

    fleet = FleetFile(str(path), roads).current()
    if fleet is None or not fleet.stops:
        return {}
    for key, place in distances(fleet, roads, path):
        where = f"{place.distance_m:.0f} m from {place.segment}, served at {place.node}"
        print(f"{path}: {key}: {where}")
    free_flow = take_snapshot(roads, (), 0, stale_after_s=STALE_AFTER_S)
    return unservable(RoutingProblem(roads, fleet), free_flow)


def _check_instance(path: Path, _: str) -> Mapping[str, str]:
    from dispatcher_daemon.planning import unservable
    from research.instances.instance import instance_from
    from research.instances.matrices import has_matrices, matrix_instance_from

    data = read_data(path)
    if has_matrices(data):
        matrix_instance_from(data, path)
        return {}
    instance = instance_from(data, path)
    return unservable(instance.problem, instance.snapshot)


_CHECKS: Final[dict[str, Callable[[Path, str], Mapping[str, str]]]] = {
    "edge": _check_edge,
    "dispatcher": _check_dispatcher,
    "agent": _check_agent,
    "dashboard": _check_dashboard,
    "scheduler": _check_scheduler,
    "worker": _check_worker,
    "fleet": _check_fleet,
    "instance": _check_instance,
}
"""Each checks a file, a fleet's on given roads, and returns stops that cannot be served."""
