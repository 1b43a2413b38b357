"""What every benchmark's report has: aims beside what was measured, and the machine."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Check:
    """One aim.

    Attributes:
        what: in words.
        measured, aim: as shown.
        reached: None where it could not be measured.
    """

    what: str
    measured: str
    aim: str
    reached: bool | None


def check_table(checks: Iterable[Check]) -> list[str]:
    """The aims as lines of a Markdown table."""
    words = {True: "reached", False: "MISSED", None: "–"}
    return [
        "| aim | measured | target | |",
        "|---|--:|--:|---|",
        *(f"| {c.what} | {c.measured} | {c.aim} | {words[c.reached]} |" for c in checks),
    ]


def machine() -> str:
    """The machine in words."""
    return f"{os.cpu_count()} cores, {_processor()}, Python {platform.python_version()}"


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
