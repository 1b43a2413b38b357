"""`slipstream bench quantum`: the paper's tables of quantum solvers, measured anew."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from slipstream.errors import InputError
from slipstream_lab.commands.bench import device as bench_device
from slipstream_lab.commands.bench import qoblib as bench_qoblib

if TYPE_CHECKING:
    from slipstream_lab.research.quantum.report import Table

_SHORT: Final = {
    "instances": 2,
    "trained": 1,
    "shots": 512,
    "iterations": 30,
    "layers": (1, 2),
}
_TABLES: Final = ("hardware", "sweep", "mitigation")
_EXIT_INTERRUPTED: Final = 130


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "bench",
        help="measure the paper's tables, QOBLIB's routing class, a device",
        description="Measures a table of the paper anew, each row beside the paper's figure; "
        "solvers and controls on a published class; or what a quantum device is good for.",
    )
    kinds = command.add_subparsers(dest="kind", required=True, metavar="KIND")
    quantum = kinds.add_parser(
        "quantum",
        help="quantum solvers on the named 25-variable instances",
        description="The paper's hardware table and p-sweep over the named instances of 25 "
        "variables, and what dynamical decoupling and twirling do against assumed idle and "
        "coherent errors: mean and spread, beside the paper's figures and marked simulated, "
        "noise-model, hardware or estimated, with what each circuit adds to its controls. "
        "Results are stored as they come; the same command goes on where it was interrupted.",
    )
    quantum.add_argument("--instances", type=int, metavar="N", help="the first N (default: 20)")
    quantum.add_argument("--shots", type=int, metavar="N", help="of each circuit (default: 4096)")
    quantum.add_argument("--seed", type=int, metavar="N", help="same seed, same shares")
    quantum.add_argument("--iterations", type=int, metavar="N", help="of training (default: 100)")
    quantum.add_argument(
        "--trained",
        type=int,
        metavar="N",
        help="instances on which dense QAOA is trained, minutes each (default: 1)",
    )
    quantum.add_argument(
        "--estimated",
        type=int,
        metavar="N",
        help="instances on which dense QAOA on the noisy device is estimated (default: 2)",
    )
    quantum.add_argument(
        "--layers", type=int, nargs="+", metavar="P", help="of the sweep (default: 1 2 3 4 5)"
    )
    quantum.add_argument(
        "--noise", metavar="BACKEND", help="with a noise model (default: aer:FakeBoston)"
    )
    quantum.add_argument("--device", metavar="NAME", help="run hardware rows on this IBM device")
    quantum.add_argument("--only", choices=_TABLES, help="one of the tables")
    quantum.add_argument(
        "--stored", action="store_true", help="measure nothing, show what is stored so far"
    )
    quantum.add_argument("--short", action="store_true", help="two instances, few shots")
    quantum.add_argument(
        "--out",
        type=Path,
        default=Path(".slipstream/bench-quantum"),
        metavar="DIR",
        help="for results and report (default: .slipstream/bench-quantum)",
    )
    quantum.add_argument(
        "--plots", type=Path, metavar="DIR", help="draw the paper's two figures into this folder"
    )
    quantum.add_argument("--json", action="store_true", help="print the report as JSON")
    quantum.set_defaults(run=run)
    bench_qoblib.add_to(kinds)
    bench_device.add_to(kinds)


def run(options: argparse.Namespace) -> int:
    """Measure what is missing and print the tables."""
    from slipstream.config import check
    from slipstream_lab.research.quantum.report import as_json, as_markdown
    from slipstream_lab.research.quantum.rows import BenchSettings
    from slipstream_lab.research.quantum.run import NOTES
    from slipstream_lab.research.quantum.run import run as measure

    names = (
        "instances",
        "shots",
        "seed",
        "iterations",
        "trained",
        "estimated",
        "layers",
        "noise",
        "device",
    )
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    settings = check((_SHORT if options.short else {}) | given, BenchSettings, "bench quantum")
    if options.plots is not None and not options.plots.is_dir():
        raise InputError(options.plots, "no such folder", "make it first", key="--plots")
    wanted = _TABLES if options.only is None else (options.only,)
    try:
        tables = measure(settings, wanted, options.out, _tell, stored=options.stored)
    except KeyboardInterrupt:
        _tell_end(options)
        return _EXIT_INTERRUPTED
    document = as_json(tables, NOTES, settings=settings.model_dump(mode="json"))
    text = as_markdown(tables, NOTES)
    _write(options.out, {"report.json": json.dumps(document), "report.md": text})
    if options.plots is not None:
        _draw(tables, options.plots)
    print(json.dumps(document) if options.json else text)
    return 0


def _write(folder: Path, texts: Mapping[str, str]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(
            folder, error.strerror or "not writable", "give another folder", key="--out"
        ) from None


def _draw(tables: Sequence[Table], folder: Path) -> None:
    try:
        from slipstream_lab.research.quantum.picture import draw

        draw(tables, folder)
    except ModuleNotFoundError as error:
        raise InputError(
            "bench quantum", f"{error.name} is not installed", "add the extra sim", key="--plots"
        ) from None
    except OSError as error:
        raise InputError(
            folder, error.strerror or "not writable", "give another folder", key="--plots"
        ) from None


def _tell_end(options: argparse.Namespace) -> None:
    """Where an interrupted run stands, in one line that begins at the left."""
    start = "\r\x1b[K" if sys.stderr.isatty() else ""
    said = "interrupted; the same command goes on from what is stored in"
    print(f"{start}slipstream: {said} {options.out}", file=sys.stderr)


def _tell(done: int, total: int, what: str) -> None:
    """What is measured at present, on a terminal."""
    if sys.stderr.isatty():
        said = f"{done} of {total}: {what}" if what else f"{total} results\n"
        sys.stderr.write(f"\r\x1b[K{said}")
        sys.stderr.flush()
