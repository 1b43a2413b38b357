"""The report of `make bench-real`: our figures beside the aims and what others have published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from slipstream_lab.benchmarks.aims import Check, at_most, check_table, machine
from slipstream_lab.benchmarks.real.boxes import BoxScore
from slipstream_lab.benchmarks.real.score import SpeedFigures

ON_ROAD, RAISED = "surveyed", "surveyed, points raised"
PUBLISHED: Final = (
    ("Macko et al. 2025, own detector, automatic calibration", "median 0.58 km/h"),
    ("the best before it, as they quote", "median 0.60 km/h"),
    ("Sochor et al. 2017, automatic calibration", "mean 1.10 km/h"),
    ("the same, manual calibration", "mean 1.35 km/h"),
    ("the same, the automatic method before it", "mean 7.98 km/h"),
)
"""arXiv 2505.01203 (abstract; all sessions of its split), arXiv 1702.06451 (abstract)."""
_HEAD: Final = (
    "camera",
    "matched",
    "bias %",
    "without it, km/h",
    "median km/h",
    "mean",
    "p95",
    "worst",
    "median %",
    "mean %",
    "in 95 %",
    "recall",
    "precision",
)


def speed_lines(tables: Mapping[str, Mapping[str, SpeedFigures]]) -> list[str]:
    """A table for each way of measuring, a line a camera."""
    lines = []
    for name, rows in tables.items():
        lines += [f"## Speeds: {name}", "", _row(_HEAD), _row(["---", *["--:"] * 12])]
        lines += [_row([camera, *_cells(figures)]) for camera, figures in rows.items()]
        lines.append("")
    lines += ["Published:", ""]
    lines += [f"- {who}: {what}" for who, what in PUBLISHED]
    return [*lines, ""]


def box_lines(scores: Mapping[str, Sequence[BoxScore]]) -> list[str]:
    """A table a model: boxes by height."""
    lines = []
    for model, rows in scores.items():
        lines += [f"## Boxes labelled by hand: {model}", ""]
        lines += ["| height, px | labelled | recall | found | precision |", "|---|--:|--:|--:|--:|"]
        lines += [
            f"| {row.heights} | {row.labelled} | {_share(row.recall)} | {row.found} "
            f"| {_share(row.precision)} |"
            for row in rows
        ]
        lines.append("")
    return lines


def checks(tables: Mapping[str, Mapping[str, SpeedFigures]]) -> list[Check]:
    """The aims, over all cameras."""
    found = []
    for name, rows in tables.items():
        total = rows.get("all")
        if total is None:
            continue
        for what, value, most in (
            ("median error", total.median_kmh, 0.6),
            ("mean error", total.mean_kmh, 1.1),
            ("p95", total.p95_kmh, 3.0),
        ):
            found.append(at_most(f"{name}: {what}, km/h", f"{value:.2f}", value, most))
        inside = total.in_interval
        found.append(
            Check(
                f"{name}: true speeds in the 95 % interval",
                _share(inside),
                "90–99 %",
                0.9 <= inside <= 0.99,
            )
        )
    return found


def render(lines: Sequence[str], found: Sequence[Check]) -> str:
    """The report as Markdown."""
    head = ["# Real roads", "", machine(), "", *check_table(found), ""]
    return "\n".join([*head, *lines]).rstrip() + "\n"


def _cells(figures: SpeedFigures) -> list[str]:
    speeds = (figures.median_kmh, figures.mean_kmh, figures.p95_kmh, figures.worst_kmh)
    shares = (figures.in_interval, figures.recall, figures.precision)
    return [
        str(figures.matched),
        f"{figures.bias_percent:+.2f}",
        f"{figures.scatter_kmh:.2f}",
        *(f"{speed:.2f}" for speed in speeds),
        f"{figures.median_percent:.2f}",
        f"{figures.mean_percent:.2f}",
        *(_share(share) for share in shares),
    ]


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f} %"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
