"""`slipstream check`: validate settings files without starting anything."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.config import load, read_toml
from slipstream.errors import InputError


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("check", help="validate settings files and what they refer to")
    command.add_argument("config", type=Path, nargs="+", help="edge, dispatcher or dashboard TOML")
    command.add_argument(
        "--as",
        dest="kind",
        choices=("edge", "dispatcher", "dashboard"),
        help="which daemon's settings they are (default: told from the file's name or content)",
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check each file; stops at the first fault."""
    for path in options.config:
        kind = options.kind or _kind_of(path)
        _CHECKS[kind](path)
        print(f"{path}: valid {kind} settings")
    return 0


def _kind_of(path: Path) -> str:
    for kind in _CHECKS:
        if kind in path.stem:
            return kind
    content = read_toml(path)
    for kind, key in (("edge", "rsu"), ("dispatcher", "fleet"), ("dashboard", "port")):
        if key in content:
            return kind
    raise InputError(path, "cannot tell which daemon it is for", "say so with --as")


def _check_edge(path: Path) -> None:
    from edge_daemon.camera import load_camera
    from edge_daemon.detection import open_detector
    from edge_daemon.settings import EdgeSettings
    from edge_daemon.sources.clip import open_clip
    from edge_daemon.watch import read_reference

    settings = load(path, EdgeSettings)
    camera = load_camera(settings.camera)
    read_reference(camera)
    open_detector(settings.detector)
    if settings.source.clip is not None:
        open_clip(settings.source.clip, loop=False, size=camera.size).close()


def _check_dispatcher(path: Path) -> None:
    from dispatcher_daemon.fleet import load_fleet
    from dispatcher_daemon.settings import DispatcherSettings
    from slipstream.roads import load_network

    settings = load(path, DispatcherSettings)
    load_fleet(settings.fleet, load_network(settings.network))


def _check_dashboard(path: Path) -> None:
    from dashboard.settings import DashboardSettings
    from slipstream.roads import load_network

    load_network(load(path, DashboardSettings).network)


_CHECKS = {"edge": _check_edge, "dispatcher": _check_dispatcher, "dashboard": _check_dashboard}
