"""`slipstream dashboard`: serve the browser page."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from slipstream.config import check
from slipstream.errors import InputError
from slipstream.service.memory import collect_garbage_less
from slipstream.site import load_site


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "dashboard", help="serve the browser page, live or of a finished run"
    )
    command.add_argument("--config", type=Path, help="the site.toml; needed but with --database")
    command.add_argument(
        "--database",
        metavar="URL",
        help="show the finished run that this database holds, in place of what happens now",
    )
    command.add_argument(
        "--network", metavar="NET", help="the finished run's road network (default: the settings')"
    )
    command.add_argument(
        "--port", type=int, help="TCP port of the operator's page (default: the settings')"
    )
    command.add_argument(
        "--allow-control",
        action="store_true",
        help="show actions, and hand them on to the dispatcher with the caller's token",
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    collect_garbage_less()
    if find_spec("viser") is None:  # it is loaded last, when the page is up
        raise ModuleNotFoundError("No module named 'viser'", name="viser")
    from dashboard.daemon import run_dashboard, show_finished_run
    from dashboard.settings import DashboardSettings

    finished = options.database is not None
    if options.config is None and not finished:
        raise InputError("dashboard", "nothing to show", "give --config or --database")
    if not finished and options.network is not None:
        raise InputError("--network", "only for a finished run", "put network into the site.toml")
    if finished and options.allow_control:
        raise InputError("--allow-control", "a finished run obeys nobody", "leave one of both out")
    settings = (
        DashboardSettings()
        if options.config is None
        else load_site(options.config, "dashboard", DashboardSettings)
    )
    changes: dict[str, Any] = {
        "database_url": options.database,
        "network": options.network,
        "port": options.port,
        "allow_control": options.allow_control or None,
    }
    changes = {name: value for name, value in changes.items() if value is not None}
    if finished:
        changes |= {"scene_port": None, "allow_control": False}
    settings = check(
        settings.model_dump() | changes, DashboardSettings, options.config or "dashboard"
    )
    if finished:
        show_finished_run(settings)
    else:
        run_dashboard(settings)
    return 0
