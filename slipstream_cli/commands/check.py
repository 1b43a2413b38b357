"""`slipstream check`: validate a site and its files, without starting anything."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream.service.logs import complain
from slipstream.site import read_site
from slipstream_cli.checks.kinds import CHECKS, Checked, kind_of
from slipstream_cli.checks.site import check_site, network_named

_MAX_FAULTS: Final = 200
"""Of all files together that are told."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "check",
        help="validate a site.toml and what it names, fleets, instances",
        description="Validates a site.toml with the camera, fleet and network files that it names, "
        "or single files. Says all faults, one line each; the exit status is then 2.",
    )
    command.add_argument(
        "config",
        type=Path,
        nargs="+",
        help="site.toml, camera, fleet, instance or file of tokens; or a folder: its TOML files",
    )
    command.add_argument(
        "--as",
        dest="kind",
        choices=("site", *CHECKS),
        help="what they are (default: told from the files' content and names)",
    )
    command.add_argument(
        "--network",
        metavar="NET",
        help="roads of fleets and cameras: a SUMO net, or demo (default: that of the site.toml "
        "beside them)",
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check all files."""
    faults: list[InputError] = []
    files: list[Checked] = []
    options.config = [*dict.fromkeys(chain.from_iterable(map(_files_of, options.config)))]
    for path in options.config:
        try:
            kind = options.kind or kind_of(path)
            if kind == "site":
                files.append(check_site(path, options.network))
            else:
                files.append(CHECKS[kind](path, options.network or _roads_of(path)))
        except InputError as error:
            faults += (error, *error.others)
    return _report(options, files, _once(faults))


def _roads_of(path: Path) -> str | None:
    """The roads of the site.toml in a file's folder; None: there is none that can be read."""
    try:
        return network_named(read_site(path.absolute().parent / "site.toml"))
    except InputError:
        return None


def _files_of(path: Path) -> Sequence[Path]:
    """A file itself; of a folder those that may be settings."""
    if not path.is_dir():
        return (path,)
    found = sorted(path.glob("*.toml"))
    if not found:
        raise InputError(path, "a folder without TOML files", "name the files")
    return found


def _once(faults: Iterable[InputError]) -> list[InputError]:
    """A fleet that a site.toml names is found faulty twice, by either path."""
    found: dict[tuple[str, str | None, str], InputError] = {}
    for fault in faults:
        found.setdefault((os.path.abspath(fault.source), fault.key, fault.problem), fault)
    return list(islice(found.values(), _MAX_FAULTS))


def _report(options: argparse.Namespace, files: list[Checked], faults: list[InputError]) -> int:
    if options.json:
        found = [
            {
                "file": str(f.path),
                "kind": f.kind,
                "notes": [*f.notes],
                "unserved": dict(f.unserved),
            }
            for f in files
        ]
        told = [
            {"file": f.source, "key": f.key, "problem": f.problem, "mend": f.mend} for f in faults
        ]
        print(json.dumps({"valid": found, "faults": told}))
        return 2 if faults else 0
    for file in files:
        for note in file.notes:
            print(note)
        print(f"{file.path}: valid {file.title}")
        for stop, reason in file.unserved.items():
            print(f"{file.path}: stop {stop} cannot be served: {reason}")
    sys.stdout.flush()
    for fault in faults:
        complain(f"slipstream: {fault}")
    return 2 if faults else 0
