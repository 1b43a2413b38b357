"""`slipstream agent`: the agents of one vehicle, or of a depot's."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.site import load_site


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("agent", help="advise one vehicle, or a depot's")
    command.add_argument("--config", type=Path, required=True, help="the site.toml")
    command.add_argument("--name", help="of the table in [agents] (default: the only one)")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    from vehicle_agent.daemon import run_agents
    from vehicle_agent.settings import AgentSettings

    run_agents(load_site(options.config, "agent", AgentSettings, options.name))
    return 0
