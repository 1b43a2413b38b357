"""`slipstream explain`: a stored cycle in words."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from slipstream.errors import InputError
from slipstream_cli.stored_cycle import add_arguments, stored_cycle


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "explain", help="why vehicles go where they go; which platoons were refused"
    )
    add_arguments(command)
    command.add_argument("--vehicle", metavar="V", help="what concerns this vehicle only")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print it."""
    from slipstream.explain import as_text, explanation

    with stored_cycle(options) as (_, stored):
        record = None if stored.inputs is None else stored.inputs.record
        found = explanation(stored.report, stored.plans, record)
    if options.vehicle is not None:
        own = found.of_vehicle(options.vehicle)
        if own is None:
            names = ", ".join(found.names[:20]) or "it has none"
            problem = f"cycle {found.cycle} has no vehicle {options.vehicle!r}"
            raise InputError("--vehicle", problem, f"give one of its vehicles: {names}")
        found = own
    print(json.dumps(asdict(found)) if options.json else as_text(found))
    return 0
