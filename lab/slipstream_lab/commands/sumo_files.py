"""The options that name a SUMO world of the user's, the same in all commands that take one."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError

if TYPE_CHECKING:
    from slipstream_lab.simulation.sumo import SumoFiles


def add_options(command: argparse.ArgumentParser, built_in: str | None = None) -> None:
    """Add ``--sumocfg``, ``--routes`` and ``--additional``; ``--net`` is the command's own."""
    instead = "instead of any demand" if built_in is None else f"or one built in: {built_in}"
    command.add_argument(
        "--sumocfg",
        type=Path,
        metavar="FILE",
        help="a SUMO configuration: net, routes, additional files, begin and end",
    )
    for part, what in (
        ("routes", f"SUMO route file {instead}"),
        ("additional", "SUMO additional file (signals, stops, types)"),
    ):
        command.add_argument(
            f"--{part}",
            type=Path,
            action="append",
            default=[],
            metavar="FILE",
            help=f"{what}; may be given more than once",
        )


def sumo_files(options: argparse.Namespace) -> SumoFiles:
    """What the options name; of a configuration a line says what of it is not taken. Raises
    InputError: a configuration that is none, or one beside a net or routes.
    """
    from slipstream_lab.simulation.sumo import SumoFiles, read_configuration

    routes, additional = tuple(options.routes), tuple(options.additional)
    if options.sumocfg is None:
        net = None if options.net is None else Path(options.net)
        return SumoFiles(net, routes, additional)
    for key, given in (("--net", options.net), ("--routes", options.routes)):
        if given:
            problem = "a SUMO configuration names it already"
            raise InputError("command line", problem, f"leave out {key} or --sumocfg", key=key)
    files = read_configuration(options.sumocfg)
    if files.ignored:
        said = f"{options.sumocfg}: not taken over: {', '.join(files.ignored)}"
        print(f"slipstream: {said}", file=sys.stderr)
    return SumoFiles(
        files.net, files.routes, (*files.additional, *additional), files.begin_s, files.end_s
    )


def scenario_name(options: argparse.Namespace, files: SumoFiles) -> str:
    """The scenario's name: as given; else that of a configuration's net; else Troy."""
    if options.scenario is not None:
        return str(options.scenario)
    if options.sumocfg is None or files.net is None:
        return "troy"
    return files.net.name.partition(".")[0]
