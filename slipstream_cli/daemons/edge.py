"""`slipstream edge`: watch one camera and publish the state of its road segments."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.site import load_site


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "edge", help="watch one camera and publish the state of its road segments"
    )
    command.add_argument("--config", type=Path, required=True, help="the site.toml")
    command.add_argument(
        "--rsu", metavar="NAME", help="the roadside unit (default: the only one with a camera)"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    from edge_daemon.daemon import run_edge
    from edge_daemon.settings import EdgeSettings

    run_edge(load_site(options.config, "edge", EdgeSettings, options.rsu))
    return 0
