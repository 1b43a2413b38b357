"""`slipstream robustness`: how many stability flags survive noise on the features."""

from __future__ import annotations

import argparse
import codecs
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError
from slipstream.files import check_file
from slipstream.messages import SegmentState, decode

if TYPE_CHECKING:
    from slipstream_lab.research.perception.noise import NoiseTable

_MAX_BYTES = 256_000_000
_MAX_LINE = 100_000
_TRACK = "slipstream track VIDEO --camera camera.toml --out states.jsonl"
_FIRST = f"make them with: {_TRACK}"


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "robustness",
        help="the paper's noise table, on measured states",
        description="Multiplies each feature of measured SegmentStates by 1 + noise·N(0, 1), "
        "applies the paper's bare rule and counts the flags that stay stable. "
        f"States are made with: {_TRACK}",
    )
    command.add_argument(
        "states", type=Path, nargs="*", metavar="STATES.jsonl", help="a SegmentState a line"
    )
    command.add_argument(
        "--noise",
        type=float,
        nargs="+",
        default=[10.0, 20.0, 30.0],
        metavar="PERCENT",
        help="levels (default: the paper's 10 20 30)",
    )
    command.add_argument("--draws", type=int, default=200, help="of noise for each state")
    command.add_argument("--seed", type=int, default=1, help="same seed, same table")
    command.add_argument("--json", action="store_true", help="print the table as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print the table."""
    from slipstream_lab.research.perception.noise import PAPER_STABLE_SHARE, noise_table

    if not options.states:
        raise InputError("STATES.jsonl", "no states given", _FIRST)
    for key, good, mend in (
        ("--noise", all(0 <= level <= 1000 for level in options.noise), "give 0 to 1000 percent"),
        ("--draws", 1 <= options.draws <= 1_000_000, "give 1 to 1000000"),
        ("--seed", options.seed >= 0, "give 0 or more"),
    ):
        if not good:
            raise InputError("robustness", "out of range", mend, key=key)
    states = [state for path in options.states for state in _read(path)]
    levels = [level / 100 for level in options.noise]
    try:
        table = noise_table(states, levels, options.draws, options.seed)
    except ValueError as error:
        source = ", ".join(str(path) for path in options.states)
        raise InputError(source, str(error), "give states of calm traffic too") from None
    if options.json:
        document = asdict(table)
        for row in document["rows"]:
            row["paper_stable_share"] = PAPER_STABLE_SHARE.get(row["noise"])
        print(json.dumps(document))
    else:
        print(_printed(table, PAPER_STABLE_SHARE))
    return 0


def _read(path: Path) -> Iterator[SegmentState]:
    check_file(path, _MAX_BYTES, _FIRST)
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                if len(line) > _MAX_LINE:
                    raise InputError(path, "too long for a state", _FIRST, key=f"line {number}")
                line = line.removeprefix(codecs.BOM_UTF8)
                if line.strip():
                    yield decode(SegmentState, line, f"{path}, line {number}")
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", "check the path") from None


def _printed(table: NoiseTable, paper: dict[float, float]) -> str:
    lines = [
        f"{table.stable} stable states of {table.segments} segments, {table.turbulent} turbulent, "
        f"{table.unknown} unknown (left out)",
        "noise   still stable      paper   turbulent turned stable",
    ]
    for row in table.rows:
        said = paper.get(row.noise)
        wrong = row.wrongly_stable_share
        lines.append(
            f"{row.noise:5.0%}   {row.stable_share:6.1%} ± {row.standard_error:5.1%}   "
            f"{'-' if said is None else format(said, '.1%'):>6}   "
            f"{'-' if wrong is None else format(wrong, '.1%'):>6}"
        )
    return "\n".join(lines)
