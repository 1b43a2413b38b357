"""The paper's two figures of its quantum benchmarks: shares by solver, and by depth."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from slipstream_lab.research.quantum.report import Table
from slipstream_lab.research.quantum.run import HARDWARE, SWEEP
from slipstream_lab.research.quantum.summary import Line
from slipstream_lab.simulation.evaluation.report import pyplot, tidy

LEAST: Final = 1e-5
"""Lower end of the axes of shares; what is less, 0 too, stands on it."""
_OURS: Final = "#0072b2"
_PAPER: Final = "#d55e00"
_UNIFORM: Final = "#777777"
_SHARES: Final[Mapping[str, str]] = MappingProxyType(
    {"p_feasible": "valid, share of all shots", "p_optimal": "optimal, share of all shots"}
)
_MARKS: Final = {"noise-model": "a device's noise, simulated", "simulated": "no noise"}
_SHAPES: Final = {"noise-model": "o", "simulated": "s"}
_GAP: Final = "gap"
_DODGE: Final = 0.12


def draw(tables: Sequence[Table], folder: Path) -> list[Path]:
    """Draw what the tables give: quantum-shares.png, quantum-depth.png.

    Raises:
        ModuleNotFoundError: matplotlib is not installed.
        OSError: a file cannot be written.
    """
    plt = pyplot()
    made = []
    for table in tables:
        if table.name not in _FIGURES:
            continue
        name, figure = _FIGURES[table.name]
        drawn = figure(plt, table)
        path = folder / name
        drawn.savefig(path, dpi=150, metadata={"Software": None})
        plt.close(drawn)
        made.append(path)
    return made


def shares_figure(plt: Any, table: Table) -> Any:
    """P_feas and P_opt of each circuit beside the paper's figure and uniform bits."""
    lines = [line for line in table.lines if _is_circuit(line) and line.figures]
    drawn, panels = plt.subplots(
        1, 2, figsize=(9.2, 0.9 + 0.36 * len(lines)), layout="constrained", sharey=True
    )
    for axes, (figure, title) in zip(panels, _SHARES.items(), strict=True):
        for row, line in enumerate(lines):
            found = line.figures.get(figure)
            if found is not None:
                axes.errorbar(
                    _shown(found.mean),
                    row,
                    xerr=[[_shown(found.mean) - _shown(found.least)], [found.most - found.mean]],
                    **_point(_OURS, "o"),
                )
            theirs = None if line.paper is None else getattr(line.paper, figure)
            if theirs is not None:
                axes.plot(_shown(theirs), row, **_point(_PAPER, "D"), markerfacecolor="white")
        uniform = _uniform(lines, figure)
        if uniform is not None:
            axes.axvline(_shown(uniform), color=_UNIFORM, linestyle="--", linewidth=1.0)
        axes.set(xscale="log", xlim=(0.8 * LEAST, 1.3), xlabel=title)
        tidy(axes)
        axes.grid(axis="x", color="#e5e5e5", linewidth=0.6)
    panels[0].set_yticks(range(len(lines)), [f"{_title(line)} ({line.mark})" for line in lines])
    panels[0].invert_yaxis()
    _legend(drawn, {"ours, with the least and the most of the instances": (_OURS, "o")})
    return drawn


def depth_figure(plt: Any, table: Table) -> Any:
    """P_feas, P_opt, and the cost above the optimum, by the number of layers."""
    drawn, panels = plt.subplots(1, 3, figsize=(9.2, 3.4), layout="constrained")
    by_mark: dict[str, dict[int, Line]] = {}
    for line in table.lines:
        if line.figures:
            by_mark.setdefault(str(line.mark), {})[_layers(line)] = line
    papers = {_layers(line): line.paper for line in table.lines if line.paper is not None}
    for axes, (figure, title) in zip(panels, [*_SHARES.items(), (_GAP, "")], strict=False):
        for number, (mark, lines) in enumerate(sorted(by_mark.items())):
            depths = sorted(lines)
            spreads = [
                lines[p].raw_gap if figure == _GAP else lines[p].figures.get(figure) for p in depths
            ]
            known = [(p, s) for p, s in zip(depths, spreads, strict=True) if s is not None]
            axes.errorbar(
                [p + _DODGE * (number - 0.5) for p, _ in known],
                [_shown(s.mean) if figure != _GAP else 100 * s.mean for _, s in known],
                [s.deviation if figure != _GAP else 100 * s.deviation for _, s in known],
                **_point(_OURS, _SHAPES.get(mark, "^")),
                linestyle="-",
            )
        theirs = [(p, getattr(row, figure)) for p, row in papers.items()]
        known_there = [(p, value) for p, value in theirs if value is not None]
        axes.plot(
            [p for p, _ in known_there],
            [100 * value if figure == _GAP else value for _, value in known_there],
            **_point(_PAPER, "D"),
            markerfacecolor="white",
            linestyle="-",
        )
        uniform = _uniform(table.lines, figure)
        if uniform is not None:
            axes.axhline(_shown(uniform), color=_UNIFORM, linestyle="--", linewidth=1.0)
        if figure == _GAP:
            axes.set(xlabel="layers p", ylabel="gap of the best raw shot, %")
            axes.set_ylim(bottom=-0.3)
        else:
            axes.set(xlabel="layers p", ylabel=title, yscale="log", ylim=(0.8 * LEAST, 1.3))
        axes.set_xticks(sorted({*papers, *(p for lines in by_mark.values() for p in lines)}))
        tidy(axes)
    ours = {
        f"ours ± deviation between instances, {_MARKS.get(mark, mark)}": (
            _OURS,
            _SHAPES.get(mark, "^"),
        )
        for mark in sorted(by_mark)
    }
    _legend(drawn, ours)
    return drawn


_FIGURES: Final[Mapping[str, tuple[str, Callable[[Any, Table], Any]]]] = MappingProxyType(
    {
        HARDWARE: ("quantum-shares.png", shares_figure),
        SWEEP: ("quantum-depth.png", depth_figure),
    }
)


def _is_circuit(line: Line) -> bool:
    return line.key.startswith(("qaoa/", "lc-qaoa/"))


def _layers(line: Line) -> int:
    found = re.search(r"/p(\d+)", line.key)
    return int(found[1]) if found else 0


def _title(line: Line) -> str:
    return line.title.replace("the paper's method", "paper's method")


def _shown(value: float) -> float:
    return max(LEAST, float(value))


def _uniform(lines: Sequence[Line], figure: str) -> float | None:
    """Exact share of uniform bits, of the first line that has it."""
    return next((line.uniform[figure] for line in lines if figure in line.uniform), None)


def _point(color: str, marker: str) -> dict[str, Any]:
    return {"color": color, "marker": marker, "markersize": 5.5, "linewidth": 1.0}


def _legend(drawn: Any, ours: Mapping[str, tuple[str, str]]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], **_point(color, marker), linestyle="none", label=label)
        for label, (color, marker) in ours.items()
    ]
    handles += [
        Line2D(
            [],
            [],
            **_point(_PAPER, "D"),
            markerfacecolor="white",
            linestyle="none",
            label="the paper",
        ),
        Line2D([], [], color=_UNIFORM, linestyle="--", linewidth=1.0, label="uniform bits"),
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=8)
