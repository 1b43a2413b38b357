"""`slipstream dispatcher`: route the fleet on a schedule."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.service.memory import collect_garbage_less
from slipstream.site import load_site


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("dispatcher", help="route the fleet on a schedule")
    command.add_argument("--config", type=Path, required=True, help="the site.toml")
    command.add_argument(
        "--standby",
        action="store_true",
        help="wait while another dispatcher writes the database, and take over when it ends",
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    collect_garbage_less()
    from dispatcher_daemon.settings import DispatcherSettings
    from dispatcher_daemon.solvers.workers import start_fork_server

    settings = load_site(options.config, "dispatcher", DispatcherSettings)
    # It loads what the workers need while this process loads the rest.
    start_fork_server()
    from storage import check_free

    if not options.standby:
        # A second dispatcher ends before it loads the solvers, which takes seconds.
        check_free(settings.database_url)
    from dispatcher_daemon.service.daemon import run_dispatcher

    run_dispatcher(settings, standby=options.standby)
    return 0
