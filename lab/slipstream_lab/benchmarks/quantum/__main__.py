"""`python -m slipstream_lab.benchmarks.quantum`: all of it; exit status 0 if all aims that were
measured are reached.

The parts are modules of this package, each with a command line of its own, and the tables are
`slipstream bench quantum`. Parts run in processes of their own, so that times are of fresh ones.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final


@dataclass(frozen=True)
class BenchPart:
    """One part.

    Attributes:
        title: for people.
        command: arguments of Python.
        short: the same with little to do.
    """

    title: str
    command: tuple[str, ...]
    short: tuple[str, ...]


def _module(name: str, *short: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    command = ("-m", f"slipstream_lab.benchmarks.quantum.{name}")
    return command, (*command, *short)


_DEVICE: Final = ("-m", "slipstream_cli", "bench", "device")
_TABLES: Final = ("-m", "slipstream_cli", "bench", "quantum")

PARTS: Final = {
    "depth": BenchPart("Two-qubit depth", *_module("depth", "--instances", "2", "--layers", "1")),
    "statevector": BenchPart(
        "State vector beside Aer",
        *_module("statevector", "--instance", "arc15-ring", "--repeats", "1"),
    ),
    "training": BenchPart(
        "Training without a device", *_module("training", "--instances", "2", "--large", "50")
    ),
    "variants": BenchPart("Variants of LC-QAOA", *_module("variants", "--short")),
    "gates": BenchPart("What entangling gates add", *_module("gates", "--short")),
    "warm_starts": BenchPart("Warm starts", *_module("warm_starts", "--short")),
    "device": BenchPart("The linear-ramp test", _DEVICE, (*_DEVICE, "--short")),
    "tables": BenchPart("The paper's tables", _TABLES, (*_TABLES, "--short")),
    "large": BenchPart(
        "Beyond 25 qubits", *_module("large", "--sizes", "50", "--shots", "100", "--no-sweeps")
    ),
    "hardware": BenchPart("A device that fails", *_module("hardware", "--cycles", "20")),
}


def run(names: Sequence[str], short: bool, out: Path, say: Callable[[str], None]) -> dict[str, int]:
    """Run parts one after the other; each part's output goes to ``out`` as well.

    Returns:
        Exit status by name.
    """
    out.mkdir(parents=True, exist_ok=True)
    statuses = {}
    for name in names:
        part = PARTS[name]
        say(f"## {part.title}\n")
        began = time.monotonic()
        done = subprocess.run(
            [sys.executable, *(part.short if short else part.command)],
            stdout=subprocess.PIPE,
            text=True,
            check=False,
        )
        (out / f"{name}.txt").write_text(done.stdout, encoding="utf-8")
        say(done.stdout)
        say(f"{name}: exit status {done.returncode}, {time.monotonic() - began:.0f} s\n")
        statuses[name] = done.returncode
    return statuses


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum", description=__doc__
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=PARTS,
        default=list(PARTS),
        metavar="PART",
        help=", ".join(PARTS),
    )
    parser.add_argument("--short", action="store_true", help="a few minutes, for a look")
    parser.add_argument("--out", type=Path, default=Path(".slipstream/bench-quantum"))
    options = parser.parse_args(arguments)
    statuses = run(options.only, options.short, options.out, lambda text: print(text, flush=True))
    return max(statuses.values())


if __name__ == "__main__":
    sys.exit(main())
