"""`slipstream check`: validate files, each by itself and together, without starting anything."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream.logs import complain
from slipstream_cli.checks.across import faults_between, nets_of, roads_of
from slipstream_cli.checks.kinds import CHECKS, Checked, kind_of, part_of

_MAX_FAULTS: Final = 200
"""Of all files together that are told."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "check",
        help="validate settings, cameras, fleets, instances, and how they fit",
        description="Validates each file by itself, and files of one site together: segments, "
        "RSUs, vehicles, ports. Says all faults, one line each; the exit status is then 2.",
    )
    command.add_argument(
        "config",
        type=Path,
        nargs="+",
        help="settings, camera, fleet, instance or file of tokens; or a folder: its TOML files",
    )
    command.add_argument(
        "--as",
        dest="kind",
        choices=tuple(CHECKS),
        help="what they are (default: told from the files' content and names)",
    )
    command.add_argument(
        "--network",
        metavar="NET",
        help="roads of fleets and cameras: a SUMO net, or demo (default: that of the dispatcher's "
        "settings among the files, or of those beside a fleet that name it)",
    )
    command.add_argument("--json", action="store_true", help="print one JSON object")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check all files, then what they have to agree about."""
    faults: list[InputError] = []
    files: list[Checked] = []
    fleets: list[Path] = []
    parts: list[Checked | None] = []
    options.config = [*dict.fromkeys(chain.from_iterable(map(_files_of, options.config)))]
    for path in options.config:
        kind = options.kind
        try:
            kind = kind or kind_of(path)
            if kind == "fleet":
                # On the roads of the dispatcher's settings, which may come later.
                fleets.append(path)
            else:
                files.append(CHECKS[kind](path, options.network))
        except InputError as error:
            faults += (error, *error.others)
            parts.append(part_of(path, kind) if kind else None)
    found = [*files, *filter(None, parts)]
    owners = {kind: [f for f in found if f.kind == kind] for kind in ("dispatcher", "dashboard")}
    if not nets_of(owners, options.network):
        files = [_without_roads(file) for file in files]
    for path in fleets:
        try:
            files.append(CHECKS["fleet"](path, roads_of(path, owners, options.network)))
        except InputError as error:
            faults += (error, *error.others)
            parts.append(part_of(path, "fleet"))
    together = sorted(
        [*files, *filter(None, parts)], key=lambda file: options.config.index(file.path)
    )
    faults += faults_between(together, options.network)
    return _report(options, files, _once(faults))


def _without_roads(file: Checked) -> Checked:
    """A file that says which of its checks needs roads that are not known."""
    if file.kind != "camera":
        return file
    note = f"{file.path}: no roads are given: its segments are not compared with any"
    return replace(
        file, notes=(*file.notes, f"{note}; give --network, or the dispatcher's settings")
    )


def _files_of(path: Path) -> Sequence[Path]:
    """A file itself; of a folder those that may be settings.

    Raises:
        InputError: a folder has none.
    """
    if not path.is_dir():
        return (path,)
    found = sorted(path.glob("*.toml"))
    if not found:
        raise InputError(path, "a folder without TOML files", "name the files")
    return found


def _once(faults: Iterable[InputError]) -> list[InputError]:
    """A fleet that the dispatcher's settings name is found faulty twice, by either path."""
    found: dict[tuple[str, str | None, str], InputError] = {}
    for fault in faults:
        found.setdefault((os.path.abspath(fault.source), fault.key, fault.problem), fault)
    return list(islice(found.values(), _MAX_FAULTS))


def _report(options: argparse.Namespace, files: list[Checked], faults: list[InputError]) -> int:
    files.sort(key=lambda file: options.config.index(file.path))
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
