"""The command `slipstream` and what all sub-commands share: errors, exit statuses."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Final

from slipstream import __version__
from slipstream.errors import InputError
from slipstream.service import follow_supervisor
from slipstream.service.logs import complain
from slipstream_cli import laboratory
from slipstream_cli.parser import EXIT_BAD_INPUT, Parser

GROUPS: Final[Mapping[str, Mapping[str, str]]] = {
    "daemons": {
        "router": "daemons.router",
        "edge": "daemons.edge",
        "dispatcher": "daemons.dispatcher",
        "agent": "daemons.agent",
        "dashboard": "daemons.dashboard",
        "scheduler": "daemons.scheduler",
        "worker": "daemons.worker",
    },
    "your place": {
        "init": "place.init",
        "import": "place.imports",
        "net": "place.net",
        "calibrate": "commands.calibrate",
        "track": "commands.track",
        "check": "commands.check",
        "rsu": "commands.instances",
        "status": "commands.status",
        "token": "commands.token",
        "orders": "commands.orders",
        "completion": "completion",
    },
    "data": {
        "export": "commands.export",
        "feed": "commands.feed",
        "explain": "commands.explain",
        "replay": "commands.replay",
        "db": "commands.db",
    },
}
"""Module by sub-command, in the groups and the order of the help; the laboratory's come after."""

COMMANDS: Final = {name: module for group in GROUPS.values() for name, module in group.items()}

_EXIT_INTERRUPTED: Final = 130
_STDOUT, _STDERR = 1, 2
_STDOUT_NAMES: Final = ("/dev/stdout", "/dev/fd/1", "/proc/self/fd/1")
_PACKAGE_OF: Final = {
    "alembic": "slipstream[dispatcher]",
    "apscheduler": "slipstream[dispatcher]",
    "cplex": "slipstream[cplex]",
    "cv2": "slipstream[edge]",
    "dimod": "slipstream[dispatcher]",
    "distributed": "slipstream[cluster]",
    "dwave": "slipstream[dispatcher]",
    "fastapi": "slipstream[dispatcher]",
    "highspy": "slipstream[dispatcher]",
    "jinja2": "slipstream[dashboard]",
    "libsumo": "slipstream-lab",
    "matplotlib": "slipstream-lab",
    "networkx": "slipstream[dispatcher]",
    "nncf": "slipstream-lab[train]",
    "openvino": "slipstream[edge]",
    "osmium": "slipstream[osm]",
    "pebble": "slipstream[dispatcher]",
    "pyarrow": "slipstream[parquet]",
    "pyproj": "slipstream[dispatcher]",
    "pyvrp": "slipstream[dispatcher]",
    "qiskit": "slipstream[dispatcher]",
    "qiskit_aer": "slipstream[dispatcher]",
    "qiskit_ibm_catalog": "slipstream[iskay]",
    "qiskit_ibm_runtime": "slipstream[dispatcher]",
    "scipy": "slipstream[edge]",
    "sqlalchemy": "slipstream[dispatcher]",
    "starlette": "slipstream[dispatcher]",
    "torch": "slipstream-lab[train]",
    "ultralytics": "ultralytics-opencv-headless",
    "uvicorn": "slipstream[dispatcher]",
    "viser": "slipstream[dashboard]",
    "yaml": "slipstream-lab[train]",
}


def parser(command: str | None = None) -> argparse.ArgumentParser:
    """The whole command line; sub-commands load their daemons only when they run.

    Args:
        command: the one of this product that is asked for: others are left out, as loading them
            takes a tenth of a daemon's start.
    """
    if command in COMMANDS:
        top = Parser(prog="slipstream")
        commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
        import_module(f"slipstream_cli.{COMMANDS[command]}").add_to(commands)
        return top
    groups = {title: tuple(commands) for title, commands in GROUPS.items()}
    top = Parser(
        prog="slipstream",
        description="Platoons where traffic is calm: roadside perception, cooperative routing.",
        epilog="Exit status: 0 on success, 2 on bad input, 1 on other faults.",
        groups=groups,
        more="" if laboratory.commands() else f"; more come with the laboratory: {laboratory.MEND}",
    )
    top.add_argument("--version", action="version", version=f"slipstream {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in COMMANDS.values():
        import_module(f"slipstream_cli.{module}").add_to(commands)
    added = laboratory.commands()
    for add_to in added.values():
        add_to(commands)
    if added:
        groups["laboratory"] = tuple(added)
    return top


def _keep_libraries_out(out: io.TextIOWrapper) -> None:
    """Leave standard output to `print`: what compiled libraries, and processes that are started,
    write to descriptor 1 goes to standard error, and never stands in an answer in JSON.
    """
    try:
        if out.fileno() != _STDOUT:
            return  # it is so already
    except io.UnsupportedOperation:
        return  # a caller in Python has put something else there
    out.flush()
    own = os.fdopen(os.dup(_STDOUT), "wb", 0 if out.write_through else -1)
    try:
        os.dup2(_STDERR, _STDOUT)
    except OSError:  # standard error is closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), _STDOUT)
    sys.stdout = io.TextIOWrapper(
        own, out.encoding, out.errors, None, out.line_buffering, out.write_through
    )


def _name_stdout(options: argparse.Namespace) -> None:
    """Standard output as a file's name is the one that `print` has."""
    for name, value in vars(options).items():
        if str(value) in _STDOUT_NAMES and isinstance(value, Path):
            setattr(options, name, Path(f"/dev/fd/{sys.stdout.fileno()}"))


def _bring(package: str) -> str:
    """How to bring a package: a release on a machine is made by its installer alone."""
    deploy = Path(sys.prefix) / "source" / "deploy"
    extra = package.removeprefix("slipstream[").removesuffix("]")
    if (deploy / "locks" / "extras" / f"{extra}.txt").is_file():
        return f"name {extra} in --extras of {deploy}/install.sh"
    role = {"edge": "edge", "dispatcher": "server", "dashboard": "server", "cluster": "worker"}
    if extra in role and deploy.is_dir():
        return f"run {deploy}/install.sh {role[extra]}"
    return f"pip install '{package}'"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit status."""
    follow_supervisor()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A file's name may hold what is no text.
        sys.stdout.reconfigure(errors="backslashreplace")
        _keep_libraries_out(sys.stdout)
    given = sys.argv[1:] if arguments is None else list(arguments)
    options = parser(next(iter(given), None)).parse_args(given)
    _name_stdout(options)
    try:
        return int(options.run(options))
    except InputError as error:
        complain(f"slipstream: {error}")
        return EXIT_BAD_INPUT
    except ModuleNotFoundError as error:
        package = _PACKAGE_OF.get((error.name or "").split(".")[0])
        if package is None:
            raise
        complain(f"slipstream: {error.name} is not installed; {_bring(package)}")
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        return _EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output is gone; Python must not complain about it once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:  # a full disk, a locked database: nobody's bad input, and no riddle
        complain(f"slipstream: {' '.join(str(error).split())}")
        return 1
