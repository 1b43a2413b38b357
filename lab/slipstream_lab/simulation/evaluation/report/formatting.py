"""Formatting of figures, and tables of them in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slipstream_cli.tables import markdown_table
from slipstream_lab.simulation.evaluation.measures import SeedSpread

NOTHING: Final = "–"


@dataclass(frozen=True)
class ReportTable:
    """A table of the report. `columns`: their heads; the first one names the rows."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    source: str
    notes: tuple[str, ...] = ()


def as_markdown(table: ReportTable) -> str:
    """A table with its heading, source and notes."""
    lines = [
        f"## {table.title}",
        "",
        markdown_table(table.columns, table.rows),
        "",
        f"Source: {table.source}.",
        *(f"\n{note}" for note in table.notes),
    ]
    return "\n".join(lines) + "\n"


def number(found: SeedSpread | float | None, digits: int, *, sign: bool = False) -> str:
    """A value, or a mean with its standard deviation where there is one."""
    if found is None:
        return NOTHING
    form = f"{'+' if sign else ''},.{digits}f"
    if not isinstance(found, SeedSpread):
        return format(_no_minus_zero(found, digits), form)
    mean = format(_no_minus_zero(found.mean, digits), form)
    return f"{mean} ± {found.deviation:,.{digits}f}" if found.deviation else mean


def percent(found: SeedSpread | float | None, digits: int = 1, *, sign: bool = False) -> str:
    """A share as a percentage."""
    if found is None:
        return NOTHING
    if isinstance(found, SeedSpread):
        deviation = None if found.deviation is None else 100 * found.deviation
        hundredfold: SeedSpread | float = SeedSpread(100 * found.mean, deviation, found.count)
    else:
        hundredfold = 100 * found
    return f"{number(hundredfold, digits, sign=sign)} %"


def count(found: SeedSpread | float | None) -> str:
    """A number of things; with a decimal where seeds differ."""
    differ = isinstance(found, SeedSpread) and bool(found.deviation)
    return number(found, 1 if differ else 0)


def join_names(names: Sequence[object]) -> str:
    """Names in a row."""
    return ", ".join(map(str, names))


def _no_minus_zero(value: float, digits: int) -> float:
    return round(value, digits) + 0.0
