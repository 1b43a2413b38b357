"""Benchmarks as commands: report on standard output, targets in the exit status."""

from __future__ import annotations

import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Check


@dataclass(frozen=True)
class Measured:
    """Result of a benchmark."""

    folder: Path
    checks: Sequence[Check]
    missing: Sequence[str] = ()


def say(text: str) -> None:
    """Print progress to standard error."""
    print(text, file=sys.stderr, flush=True)


def parts_of(text: str, known: Sequence[str]) -> tuple[str, ...]:
    """Names of a benchmark's parts, separated by commas, in the order of those known. Raises
    InputError: an unknown one.
    """
    names = text.split(",")
    for name in names:
        if name not in known:
            raise InputError("--only", f"no part {name!r}", f"use some of {', '.join(known)}")
    return tuple(part for part in known if part in names)


def report(name: str, measure: Callable[[], Measured], *, as_json: bool) -> int:
    """Measure and print the report.

    Args:
        measure: may raise InputError for bad input, RuntimeError where a run of ours failed.

    Returns:
        Exit status: 0 where all aims that were measured are reached and nothing is missing, 2 on
        bad input, 130 after an interruption, else 1.
    """
    try:
        measured = measure()
    except InputError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    except RuntimeError as error:
        traceback.print_exc()
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    file = measured.folder / ("report.json" if as_json else "report.md")
    print(file.read_text(encoding="utf-8"), end="")
    missed = any(check.reached is False for check in measured.checks)
    return 1 if missed or measured.missing else 0


def start(main: Callable[[], int]) -> None:
    """Run a command's main; SIGTERM raises KeyboardInterrupt in it."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(main())
