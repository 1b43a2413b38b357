"""`slipstream agent`: the agents of one vehicle, or of a depot's."""

from __future__ import annotations

import argparse
from pathlib import Path

from slipstream.errors import InputError
from slipstream.site import load_site
from slipstream_cli.commands.instances import add_agent_actions


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "agent",
        help="advise one vehicle, or a depot's; or add such agents to a site",
        description="Advises the vehicles of a table in [agents], or changes which there are.",
    )
    command.add_argument("--config", type=Path, help="the site.toml")
    command.add_argument("--name", help="of the table in [agents] (default: the only one)")
    command.set_defaults(run=run)
    add_agent_actions(command)


def run(options: argparse.Namespace) -> int:
    """Run the daemon until it is stopped."""
    from vehicle_agent.daemon import run_agents
    from vehicle_agent.settings import AgentSettings

    if options.config is None:
        raise InputError("--config", "is missing", "give the site.toml, or an action: add, remove")
    run_agents(load_site(options.config, "agent", AgentSettings, options.name))
    return 0
