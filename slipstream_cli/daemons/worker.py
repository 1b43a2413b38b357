"""`slipstream worker`: a worker of a cluster."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.site import load_site


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("worker", help="solve for the dispatcher of another machine")
    command.add_argument("--config", type=Path, required=True, help="the site.toml")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the worker until it is stopped."""
    from dispatcher_daemon.settings import WorkerSettings
    from dispatcher_daemon.solvers.cluster.members import run_worker

    run_worker(load_site(options.config, "worker", WorkerSettings))
    return 0
