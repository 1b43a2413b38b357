"""`slipstream bench qoblib`: solvers, circuits and controls on QOBLIB's vehicle routing class."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine

_SETTINGS: Final = ("instances", "seeds", "circuit", "layers", "iterations", "shots", "limit")
_EXIT_INTERRUPTED: Final = 130


def add_to(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add it to the kinds of `slipstream bench`."""
    command = kinds.add_parser(
        "qoblib",
        help="exact, routing search, annealing and circuits on QOBLIB's routing instances",
        description="Runs the exact solver, the routing search, simulated annealing and a circuit "
        "on each instance, and beside the circuit its controls with the processor time that it "
        "took: its own marginals, itself without entangling gates, random starts with one-flip "
        "descent, uniform random bits. Writes tables, and folders in QOBLIB's submission form. "
        "Results are stored as they come; the same command goes on where it was interrupted.",
    )
    command.add_argument(
        "--class", dest="problems", choices=("routing",), required=True, help="of the library"
    )
    command.add_argument(
        "--data",
        type=Path,
        required=True,
        metavar="DIR",
        help="your copy of the library, its 09-routing, or a folder with .vrp files",
    )
    command.add_argument(
        "--instances",
        type=int,
        metavar="N",
        help="the N with the fewest routes to choose from (default: all)",
    )
    command.add_argument("--seeds", type=int, metavar="N", help="runs of each solver (default: 3)")
    command.add_argument(
        "--circuit", metavar="VARIANT", help="trained (default), ramp or multi-angle"
    )
    command.add_argument("--layers", type=int, metavar="P", help="of the circuit (default: 1)")
    command.add_argument("--iterations", type=int, metavar="N", help="of training (default: 30)")
    command.add_argument("--shots", type=int, metavar="N", help="of the circuit (default: 4096)")
    command.add_argument(
        "--limit", type=float, metavar="S", help="wall time of one run, s (default: 60)"
    )
    command.add_argument(
        "--submitter", default="N/A", metavar="NAME", help="for the submission's tables"
    )
    command.add_argument(
        "--stored", action="store_true", help="run nothing, show what is stored so far"
    )
    command.add_argument(
        "--out",
        type=Path,
        default=Path(".slipstream/bench-qoblib"),
        metavar="DIR",
        help="for results and tables (default: .slipstream/bench-qoblib)",
    )
    command.add_argument("--json", action="store_true", help="print the report as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Make the missing runs and print the tables; exit status 1 without any answer."""
    from slipstream.config import check
    from slipstream_lab.research.qoblib.bench import QoblibSettings
    from slipstream_lab.research.qoblib.bench import run as measure
    from slipstream_lab.research.qoblib.report import as_json, as_markdown, lines_of, submissions

    given = {name: getattr(options, name) for name in _SETTINGS}
    given = {name: value for name, value in given.items() if value is not None}
    settings = check(given, QoblibSettings, "bench qoblib")
    try:
        with ProgressLine("bench qoblib", sys.stderr) as progress:
            cases = measure(
                settings, options.data, options.out, progress.update, stored=options.stored
            )
    except KeyboardInterrupt:
        said = "interrupted; the same command goes on from what is stored in"
        print(f"slipstream: {said} {options.out}", file=sys.stderr)
        return _EXIT_INTERRUPTED
    document, text = as_json(cases, settings), as_markdown(cases, settings)
    files = [("report.json", json.dumps(document) + "\n"), ("report.md", text + "\n")]
    _write(options.out, [*files, *submissions(cases, options.submitter)])
    print(json.dumps(document) if options.json else text)
    return 0 if any(line.feasible for line in lines_of(cases)) else 1


def _write(folder: Path, texts: Iterable[tuple[str, str]]) -> None:
    try:
        for name, text in texts:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(
            folder, error.strerror or "not writable", "give another folder", key="--out"
        ) from None
