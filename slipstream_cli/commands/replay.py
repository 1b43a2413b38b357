"""`slipstream replay`: a stored cycle made again from its inputs, and what came out otherwise."""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

from slipstream.errors import InputError
from slipstream_cli.stored_cycle import add_arguments, stored_cycle


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("replay", help="make a stored cycle again: is its plan the same?")
    add_arguments(command)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Make it again and print what differs."""
    from dispatcher_daemon.planning.replay import replayed, restored_settings
    from dispatcher_daemon.solvers import configured_solvers
    from dispatcher_daemon.solvers.workers import solve_in_process

    with stored_cycle(options) as (reader, stored), ThreadPoolExecutor(1) as thread:
        if stored.inputs is None:
            number, report = stored.report.cycle, stored.report
            if report.solver is None:
                why = f"cycle {number} made no plan: {report.reason or report.status}"
                raise InputError(options.database, why, "give a cycle that made plans")
            raise InputError(
                options.database,
                f"the inputs of cycle {number} are not stored, or not any more",
                "give a later one: inputs are kept for a week",
            )
        solve = solve_in_process(configured_solvers(restored_settings(stored.inputs)))
        found = replayed(stored, reader.plan, solve, thread)
    if options.json:
        print(json.dumps({**asdict(found), "same": not found.differences}))
    else:
        for note in found.notes:
            print(note)
        for difference in found.differences:
            print(difference)
        result = "not the same" if found.differences else "the same"
        print(f"cycle {found.cycle}: {result}, {found.vehicles} plans compared")
    return 1 if found.differences else 0
