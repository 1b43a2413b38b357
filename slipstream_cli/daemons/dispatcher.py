"""`slipstream dispatcher`: route the fleet on a schedule."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.config import load


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("dispatcher", help="route the fleet on a schedule")
    command.add_argument("--config", type=Path, required=True, help="settings (TOML)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    from dispatcher_daemon.daemon import run_dispatcher
    from dispatcher_daemon.settings import DispatcherSettings

    run_dispatcher(load(options.config, DispatcherSettings))
    return 0
