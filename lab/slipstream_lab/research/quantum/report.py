"""The tables as Markdown, which reads well in a terminal too, and as plain data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from slipstream_lab.research.quantum.summary import Line, ShareSpread

_CONTROLLED: Final = (
    "p_feasible",
    "p_optimal",
    "p_optimal_descended",
    "p_optimal_repaired",
)

_HEAD: Final = (
    "solver",
    "how",
    "n",
    "2q depth",
    "paper",
    "wall, s",
    "paper",
    "P_feas raw, %",
    "paper",
    "P_opt raw, %",
    "paper",
    "descended, %",
    "repaired, %",
    "optimum raw",
    "optimum",
    "QUBO cost, kWh",
    "paper",
    "gap raw, %",
    "gap, %",
    "paper",
    "energy, kWh",
    "paper",
)


@dataclass(frozen=True)
class Table:
    """One table.

    Attributes:
        name: in the JSON.
        title: for people.
        lines: its rows.
    """

    name: str
    title: str
    lines: tuple[Line, ...]


def as_json(tables: Sequence[Table], notes: Sequence[str], **about: Any) -> dict[str, Any]:
    """Everything as plain data."""
    rows = {table.name: [asdict(line) for line in table.lines] for table in tables}
    return {**about, "notes": list(notes), "tables": rows}


def as_markdown(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """The tables with a line for each row, then what circuits add to their controls."""
    return "\n".join(_document(tables, notes))


def _document(tables: Sequence[Table], notes: Sequence[str]) -> Iterator[str]:
    for table in tables:
        yield f"### {table.title}"
        yield ""
        yield from _markdown(_HEAD, [_cells(line) for line in table.lines])
        yield ""
    lines = {line.key: line for table in tables for line in table.lines if line.added}
    if lines:
        yield "### What the circuits add to their controls, points of a hundred"
        yield ""
        head = ("solver", "how", "control", *(f"{_name(figure)}" for figure in _CONTROLLED))
        yield from _markdown(head, [row for line in lines.values() for row in _controls(line)])
        yield ""
    for line in {line.key: line for table in tables for line in table.lines}.values():
        if line.reason is not None:
            yield f"- {line.title}: {line.reason}"
    for note in notes:
        yield f"- {note}"


def _cells(line: Line) -> list[str]:
    paper, figures = line.paper, line.figures
    count = max((s.count for s in figures.values()), default=0)

    def share(value: float | None) -> str:
        return "" if value is None else f"{100 * value:.1f}"

    def hits(value: int | None) -> str:
        return "" if value is None else f"{value} of {count}"

    return [
        line.title,
        line.mark,
        str(count) if count else "",
        _plain(figures.get("two_qubit_depth"), 0),
        "" if paper is None or paper.two_qubit_depth is None else str(paper.two_qubit_depth),
        _plain(figures.get("wall_s"), 2),
        "" if paper is None else f"{paper.wall_s:.2f}",
        _percent(figures.get("p_feasible")),
        "" if paper is None else share(paper.p_feasible),
        _percent(figures.get("p_optimal")),
        "" if paper is None else share(paper.p_optimal),
        _pair(line, "descended"),
        _pair(line, "repaired"),
        hits(line.raw_hits),
        hits(line.hits),
        _plain(figures.get("best_cost"), 4),
        "" if paper is None or paper.cost is None else f"{paper.cost:.3f}",
        _percent(line.raw_gap),
        _percent(line.gap),
        share(None if paper is None else paper.gap),
        _plain(figures.get("energy_kwh"), 2),
        "" if paper is None or paper.energy_kwh is None else f"{paper.energy_kwh:.1f}",
    ]


def _controls(line: Line) -> Iterator[list[str]]:
    for control in dict.fromkeys(added.control for added in line.added):
        found = {a.figure: a for a in line.added if a.control == control}
        row = [line.title, line.mark, control]
        for figure in _CONTROLLED:
            added = found.get(figure)
            row.append(
                ""
                if added is None
                else f"{100 * added.control_mean:.2f}: {100 * added.value:+.2f} "
                f"±{100 * added.shot_error:.2f} ±{100 * added.spread_error:.2f}"
            )
        yield row


def _name(figure: str) -> str:
    words = {"feasible": "P_feas", "optimal": "P_opt"}
    _, kind, *stage = figure.split("_")
    return f"{words[kind]} {stage[0] if stage else 'raw'}"


def _plain(spread: ShareSpread | None, digits: int) -> str:
    if spread is None:
        return ""
    mean = f"{spread.mean:.{digits}f}"
    return mean if spread.least == spread.most else f"{mean} ± {spread.deviation:.{digits}f}"


def _percent(spread: ShareSpread | None) -> str:
    return (
        "" if spread is None else f"{_short(100 * spread.mean)} ± {_short(100 * spread.deviation)}"
    )


def _short(percent: float) -> str:
    """One decimal from 1 on, two significant digits below."""
    return f"{percent:.1f}" if percent >= 1 or percent == 0 else f"{percent:.2g}"


def _pair(line: Line, stage: str) -> str:
    """Mean P_feas / P_opt of a stage."""
    found = [line.figures.get(f"p_{kind}_{stage}") for kind in ("feasible", "optimal")]
    return " / ".join(f"{100 * s.mean:.1f}" for s in found if s is not None)


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, None, *rows):
        cells = (
            ["-" * width for width in widths]
            if row is None
            else [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        )
        yield "| " + " | ".join(cells) + " |"
