"""The benchmark's report: measured values with their targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from slipstream_cli.tables import markdown_table
from slipstream_lab.benchmarks.aims import Check, report_head, write_report
from slipstream_lab.benchmarks.world.figures import (
    Repeat,
    Saved,
    TimedRun,
    repeat_checks,
    saving_checks,
    time_checks,
)


@dataclass(frozen=True)
class WorldResults:
    """All that was measured."""

    runs: tuple[TimedRun, ...] = ()
    repeats: tuple[Repeat, ...] = ()
    saved: tuple[Saved, ...] = ()
    tables: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


def checks(results: WorldResults) -> list[Check]:
    """Each aim with what was measured."""
    return [
        *time_checks(results.runs),
        *repeat_checks(results.repeats),
        *saving_checks(results.saved),
    ]


def markdown(results: WorldResults, about: Mapping[str, object]) -> str:
    """The report as people read it."""
    lines = report_head(
        "Worlds: how fast, how repeatable, what they save", about, checks(results), results.missing
    )
    if results.runs:
        lines += ["", "## Times", "", _run_table(results.runs)]
    different = [f"{r.scenario}: {', '.join(r.different)}" for r in results.repeats if r.different]
    if different:
        lines += ["", "## Not the same bytes", "", *(f"- {line}" for line in different)]
    if results.tables:
        lines += ["", "## Tables", "", *(f"- {folder}/report.md" for folder in results.tables)]
    return "\n".join(lines) + "\n"


def write(folder: Path, results: WorldResults, about: Mapping[str, object]) -> None:
    """Write report.md and report.json into an existing folder."""
    content = {"checks": [asdict(c) for c in checks(results)], **asdict(results)}
    write_report(folder, markdown(results, about), about, content)


def _run_table(runs: Sequence[TimedRun]) -> str:
    columns = (
        *("world", "seed", "what", "hours", "s", "processor, s", "peak, MB"),
        "others at once",
    )
    rows = (
        (
            *(r.scenario, r.seed, r.what, f"{r.hours:g}", f"{r.wall_s:.1f}", f"{r.cpu_s:.1f}"),
            *(f"{r.peak_mb:.0f}", r.beside),
        )
        for r in runs
    )
    return markdown_table(columns, rows, left=(0, 2))
