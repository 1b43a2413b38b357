"""`slipstream scheduler`: the scheduler of a cluster of workers."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.site import load_site


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "scheduler", help="distribute a dispatcher's solving over the workers of a cluster"
    )
    command.add_argument("--config", type=Path, required=True, help="the site.toml")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the scheduler until it is stopped."""
    from dispatcher_daemon.settings import SchedulerSettings
    from dispatcher_daemon.solvers.cluster.members import run_scheduler

    run_scheduler(load_site(options.config, "scheduler", SchedulerSettings))
    return 0
