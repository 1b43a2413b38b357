"""Common parts of benchmark reports: targets with measured values, and the machine."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import psutil


@dataclass(frozen=True)
class Check:
    """One aim. `reached`: None where it could not be measured."""

    what: str
    measured: str
    aim: str
    reached: bool | None


def at_most(what: str, measured: str, value: float, most: float) -> Check:
    """An aim that is reached up to a limit."""
    return Check(what, measured, f"≤ {most:g}", value <= most)


def at_least(what: str, measured: str, value: float, least: float) -> Check:
    """An aim that is reached from a limit on."""
    return Check(what, measured, f"≥ {least:g}", value >= least)


def check_table(checks: Iterable[Check]) -> list[str]:
    """The aims as lines of a Markdown table."""
    words = {True: "reached", False: "MISSED", None: "–"}
    return [
        "| aim | measured | target | |",
        "|---|--:|--:|---|",
        *(f"| {c.what} | {c.measured} | {c.aim} | {words[c.reached]} |" for c in checks),
    ]


def report_head(
    title: str, about: Mapping[str, object], checks: Iterable[Check], missing: Iterable[str] = ()
) -> list[str]:
    """The first lines of a report."""
    return [
        f"# {title}",
        "",
        *(f"- {name}: {value}" for name, value in about.items()),
        *(f"- **not measured:** {why}" for why in missing),
        "",
        *check_table(checks),
    ]


def write_report(
    folder: Path, text: str, about: Mapping[str, object], content: Mapping[str, object]
) -> None:
    """Write report.md and report.json into an existing folder."""
    (folder / "report.md").write_text(text, encoding="utf-8")
    data = {"about": dict(about), **content}
    encoded = json.dumps(data, indent=1, default=str)
    (folder / "report.json").write_text(encoded + "\n", encoding="utf-8")


@dataclass(frozen=True)
class Load:
    """Load of the machine by other processes since this object was created."""

    before: float = field(default_factory=lambda: os.getloadavg()[0])
    stolen_s: float = field(default_factory=lambda: _times_s()[0])
    total_s: float = field(default_factory=lambda: _times_s()[1])

    def figures(self) -> dict[str, str]:
        """Figures until now, as lines of a report."""
        stolen_s, total_s = _times_s()
        share = (stolen_s - self.stolen_s) / max(total_s - self.total_s, 1e-9)
        return {
            "load before and after": f"{self.before:.2f}, {os.getloadavg()[0]:.2f}",
            "processor time that the host kept for others": f"{100 * share:.1f} %",
        }


def _times_s() -> tuple[float, float]:
    """(Steal time, total time) of all cores since boot, s."""
    times = psutil.cpu_times()
    # The time of virtual machines is in `user` and `nice` too.
    twice = getattr(times, "guest", 0.0) + getattr(times, "guest_nice", 0.0)
    return getattr(times, "steal", 0.0), sum(times) - twice


def measured_on(load: Load, **others: object) -> dict[str, object]:
    """The machine, its load until now, what else a report names, and the date."""
    date = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())
    return {"machine": machine(), **load.figures(), **others, "date": date}


def machine() -> str:
    """The machine in words."""
    return f"{os.cpu_count()} cores, {_processor()}, Python {platform.python_version()}"


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
