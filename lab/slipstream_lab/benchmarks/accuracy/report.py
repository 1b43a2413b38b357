"""The table: each clip, each world and all clips together, beside the targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slipstream_lab.research.perception import CountScore, Scores

_COLUMNS: Final = (
    ("speed MAE", "speed_mae_kmh", 1.0),
    ("p95 km/h", "speed_p95_kmh", 3.0),
    ("in 95 %", "speed_covered_95", None),
    ("σ²_a error", "acceleration_variance_abs_error", 0.1),
    ("y_e", "y_e_agreement", -0.95),
    ("y_e outside", "y_e_agreement_outside_band", -0.98),
    ("known", "y_e_known", None),
    ("IDF1", "idf1", -0.95),
    ("HOTA", "hota", None),
)
"""Heading, field, target: at most, or at least if negative."""


_MAX_COUNT_ERROR: Final = 0.05
_MAX_CLASS_ERROR: Final = 0.1


@dataclass(frozen=True)
class AccuracyRow:
    """One line of the table."""

    name: str
    scores: Scores


def table(rows: Sequence[AccuracyRow], totals: Sequence[AccuracyRow]) -> str:
    """The table as text; what misses its target is marked with '!' in the totals."""
    width = max(len(row.name) for row in (*rows, *totals, AccuracyRow("target", totals[0].scores)))
    head = " ".join(f"{heading:>12}" for heading, _, _ in _COLUMNS)
    lines = [f"{'':{width}} {head}"]
    lines += [_line(row, width, mark=False) for row in rows]
    lines += [_line(row, width, mark=True) for row in totals]
    targets = " ".join(f"{_wanted(target):>12}" for _, _, target in _COLUMNS)
    lines.append(f"{'target':{width}} {targets}")
    return "\n".join(lines)


def features(total: Scores) -> str:
    """Error, bias and coverage of each feature."""
    lines = [f"{'feature':30} {'mean |error|':>12} {'bias':>9} {'in 95 %':>9} {'windows':>8}"]
    for name, figures in total.features.items():
        covered = "" if figures.covered_95 is None else f"{figures.covered_95:.3f}"
        lines.append(
            f"{name:30} {figures.mean_abs_error:12.4f} {figures.bias:9.4f} "
            f"{covered:>9} {figures.windows:8d}"
        )
    return "\n".join(lines)


def classes(total: Scores) -> str:
    """How well each class is followed."""
    lines = [f"{'class':12} {'vehicles':>9} {'followed':>9} {'speed MAE':>10} {'speeds':>8}"]
    for name, figures in total.classes.items():
        mean = "" if figures.speed_mae_kmh is None else f"{figures.speed_mae_kmh:.3f}"
        lines.append(
            f"{name:12} {figures.vehicles:9d} {figures.followed:9.3f} {mean:>10} "
            f"{figures.speeds:8d}"
        )
    return "\n".join(lines)


def counts(rows: Sequence[tuple[str, CountScore]]) -> str:
    """Counted vehicles beside the truth, a line a clip or a group of them: all and by class as
    counted/true, and how far mean speed and 85th percentile are off.
    """
    width = max(len(name) for name, _ in rows)
    names = list(rows[0][1].by_class)
    heads = ("counted", "error", "in 95 %", *names, "mean km/h", "v85 km/h")
    lines = [f"{'counts':{width}} " + " ".join(f"{head:>10}" for head in heads)]
    for name, one in rows:
        cells = (
            f"{one.counted}/{one.true}",
            "" if one.error is None else f"{one.error:+.1%}",
            "" if one.covered_95 is None else f"{one.covered_95:.2f}",
            *(f"{counted}/{true}" for true, counted in one.by_class.values()),
            "" if one.mean_error_kmh is None else f"{one.mean_error_kmh:.2f}",
            "" if one.v85_error_kmh is None else f"{one.v85_error_kmh:.2f}",
        )
        lines.append(f"{name:{width}} " + " ".join(f"{cell:>10}" for cell in cells))
    return "\n".join(lines)


def count_misses(total: CountScore) -> list[str]:
    """Targets of counts that are not reached, in words."""
    wanted = [("counts", total.error, _MAX_COUNT_ERROR)]
    wanted += [
        (f"counts, {name}", error, _MAX_CLASS_ERROR) for name, error in total.class_errors.items()
    ]
    return [
        f"{name}: {'nothing to count' if error is None else f'{error:+.1%}'}, target ± {most:.0%}"
        for name, error, most in wanted
        if error is None or abs(error) > most
    ]


def misses(total: Scores) -> list[str]:
    """Targets that the figures do not reach, in words."""
    return [
        f"{heading}: {getattr(total, field)}, target {_wanted(target)}"
        for heading, field, target in _COLUMNS
        if target is not None and _missed(getattr(total, field), target)
    ]


def _wanted(target: float | None) -> str:
    if target is None:
        return ""
    return f"≤ {target:g}" if target > 0 else f"≥ {-target:g}"


def _missed(value: float | None, target: float) -> bool:
    return value is None or (value > target if target > 0 else value < -target)


def _line(row: AccuracyRow, width: int, *, mark: bool) -> str:
    cells = []
    for _, field, target in _COLUMNS:
        value = getattr(row.scores, field)
        text = "" if value is None else f"{value:.3f}"
        cells.append(text + ("!" if mark and target is not None and _missed(value, target) else ""))
    return f"{row.name:{width}} " + " ".join(f"{cell:>12}" for cell in cells)
