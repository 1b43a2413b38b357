"""`slipstream dashboard`: serve the browser page."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.config import load


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("dashboard", help="serve the browser page")
    command.add_argument("--config", type=Path, required=True, help="settings (TOML)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    from dashboard.daemon import run_dashboard
    from dashboard.settings import DashboardSettings

    run_dashboard(load(options.config, DashboardSettings))
    return 0
