"""`slipstream import vrplib|solomon|qoblib`: problems of the published sets as instance files."""

from __future__ import annotations

import argparse
from pathlib import Path

_FORMATS = {
    "vrplib": "CVRPLIB's files (.vrp): distances rounded to whole numbers",
    "solomon": "Solomon's files (.txt): time windows, distances cut to tenths",
    "qoblib": "QOBLIB's routing files (.vrp): no more vehicles than the name says",
}


def add_formats(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the formats to those of `slipstream import`."""
    for name, what in _FORMATS.items():
        kind = kinds.add_parser(
            name, help=what, description=f"{what}. `slipstream solve --instance` takes the result."
        )
        kind.add_argument("files", type=Path, nargs="+", metavar="FILE", help="of the set")
        kind.add_argument(
            "--out", type=Path, required=True, metavar="DIR", help="for the instances"
        )
        kind.add_argument(
            "--solution",
            type=Path,
            metavar="FILE.sol",
            help="with the best known cost (default: the file of the same name, if there is one)",
        )
        kind.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write an instance for each file; all are read before the first is written."""
    from slipstream.errors import InputError
    from slipstream_lab.research.instances.matrices import read_published, write_matrix_instance

    if options.solution is not None and len(options.files) > 1:
        mend = "import one file at a time, or put solutions beside the files"
        raise InputError("--solution", "is of one file only", mend)
    targets: dict[Path, Path] = {}
    for path in options.files:
        target = options.out / f"{path.stem}.json"
        if target in targets:
            problem = f"would be written from {targets[target]} too"
            raise InputError(path, problem, "import one of them into another folder")
        targets[target] = path
    read = {
        target: read_published(path, options.kind, options.solution)
        for target, path in targets.items()
    }
    for target, instance in read.items():
        write_matrix_instance(instance, target)
        fleet, best = instance.fleet, instance.file.best_known
        known = "" if best is None else f", best known {best.cost:.10g}"
        known += f" ({best.note})" if best is not None and best.note else ""
        print(f"{target}: {len(fleet.stops)} stops, {len(fleet.vehicles)} vehicles{known}")
    return 0
