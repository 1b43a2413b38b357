"""The coordination benchmark's report and picture."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from benchmarks.aims import Check, check_table
from benchmarks.coordination.cells import Place, Result, Row
from research.coordination.strategies import STRATEGIES
from slipstream.tables import markdown_table

OWN: Final = "local search"
"""The strategy that the aims are judged by."""
_AIM_SHARE: Final = 0.9
_NONE_KWH: Final = 1e-6
_PLACES: Final[Mapping[Place, str]] = {
    "one": "corridor, one carrier",
    "ten": "corridor, ten carriers",
    "region": "region, ten carriers",
}
_COLOURS: Final = ("#777777", "#cc79a7", "#009e73", "#d55e00", "#0072b2")
_PICTURE_PRICE_KW: Final = 10
_PICTURE_WINDOW_MIN: Final = 10


def checks(results: Iterable[Result]) -> list[Check]:
    """The aims of our own strategy."""
    shares, ahead, worst = [], [], []
    for result in results:
        own = _row(result, OWN)
        if result.bounded.bound_kwh > _NONE_KWH:
            shares.append(own.net_kwh / result.bounded.bound_kwh)
        rivals = [row.net_kwh for row in result.plans.rows if row.strategy != OWN and _is_fair(row)]
        ahead.append(own.net_kwh - max(rivals))
        worst.append(own.worst_carrier_kwh)
    if not shares:
        return []
    reached = sum(share >= _AIM_SHARE for share in shares)
    return [
        Check(
            "share of the upper bound in each cell, lowest",
            f"{min(shares):.1%}; {reached} of {len(shares)} reach it",
            f"≥ {_AIM_SHARE:.0%}",
            min(shares) >= _AIM_SHARE,
        ),
        Check(
            "cells in which no rival is better that makes no carrier worse off",
            f"{sum(gap >= -_NONE_KWH for gap in ahead)} of {len(ahead)}",
            "all",
            min(ahead) >= -_NONE_KWH,
        ),
        Check(
            "worst carrier against driving alone, kWh",
            f"{min(worst):.2f}",
            "≥ 0",
            min(worst) >= -_NONE_KWH,
        ),
    ]


def write(folder: Path, results: Sequence[Result], about: Mapping[str, object]) -> None:
    """Write report.md and report.json into an existing folder."""
    (folder / "report.md").write_text(markdown(results, about), encoding="utf-8")
    content = {
        "about": dict(about),
        "checks": [asdict(c) for c in checks(results)],
        "results": [asdict(result) for result in results],
    }
    (folder / "report.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def markdown(results: Sequence[Result], about: Mapping[str, object]) -> str:
    """The report as people read it."""
    lines = ["# Coordination: share of the drafting ceiling by density", ""]
    lines += [f"- {name}: {value}" for name, value in about.items()]
    lines += ["", *check_table(checks(results))]
    for price_kw in dict.fromkeys(r.cell.price_kw for r in results):
        some = [r for r in results if r.cell.price_kw == price_kw]
        lines += ["", f"## Waiting at {price_kw} kW", "", *_net(some), "", *_ours(some)]
    return "\n".join(lines) + "\n"


def _net(results: Iterable[Result]) -> list[str]:
    rows = []
    for r in results:
        shares = [_share(r, _row(r, name)) for name in STRATEGIES]
        tight = (
            f"{r.best.net_kwh / r.bounded.bound_kwh:.1%}"
            if r.bounded.bound_kwh > _NONE_KWH
            else "–"
        )
        bound = f"{r.bound_share:.1%}"
        rows.append((*_cell(r), *shares, bound, tight))
    columns = (*_CELL_COLUMNS, *STRATEGIES, "bound", "best of the bound")
    text = (
        "Net value (drafting less stops and waiting) as a share of the drafting ceiling; \\*: a "
        "carrier has less than alone:"
    )
    return [text, "", markdown_table(columns, rows)]


def _ours(results: Iterable[Result]) -> list[str]:
    rows = []
    for r in results:
        own = _row(r, OWN)
        rows.append(
            (
                *_cell(r),
                f"{own.drafting_kwh:.1f}",
                f"{own.drafting_kwh / r.plans.ceiling_kwh:.1%}",
                f"{own.stops_kwh:.1f}",
                f"{own.mean_wait_s:.0f}",
                f"{own.max_wait_s:.0f}",
                f"{own.platooned_km / r.plans.open_km:.1%}",
                f"{own.worst_carrier_kwh:.2f}",
                f"{own.wall_s:.1f}",
                f"{r.bounded.bin_s:g}",
                f"{r.bounded.wall_s:.1f}",
            )
        )
    columns = (
        *_CELL_COLUMNS, "drafting, kWh", "of the ceiling", "stops, kWh", "mean wait, s",
        "longest, s", "platooned km", "worst carrier, kWh", "planned in, s", "bins, s",
        "bounded in, s",
    )  # fmt: skip
    return [f"{OWN}, and the bound's bins:", "", markdown_table(columns, rows)]


_CELL_COLUMNS: Final = ("place", "vehicles", "window, min")


def _cell(result: Result) -> tuple[str, str, str]:
    cell = result.cell
    return _PLACES[cell.place], f"{cell.vehicles:,}", f"±{cell.window_min}"


def _row(result: Result, strategy: str) -> Row:
    return next(row for row in result.plans.rows if row.strategy == strategy)


def draw(results: Sequence[Result], folder: Path) -> Path | None:
    """Draw the curve, coordination.png; None where no density was planned as it needs."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    shown = [
        r
        for r in results
        if (r.cell.price_kw, r.cell.window_min) == (_PICTURE_PRICE_KW, _PICTURE_WINDOW_MIN)
        and r.cell.place != "region"
    ]
    if len(shown) < 2:
        return None
    figure, panels = pyplot.subplots(
        1, 2, figsize=(9.0, 4.2), layout="constrained", sharey=True, squeeze=True
    )
    for axes, place in zip(panels, ("one", "ten"), strict=True):
        of_place = sorted((r for r in shown if r.cell.place == place), key=_vehicles)
        _panel(axes, of_place, _PLACES["one" if place == "one" else "ten"])
    panels[0].set_ylabel("net value, % of the drafting ceiling")
    panels[1].legend(frameon=False, loc="upper left", fontsize=8)
    path = folder / "coordination.png"
    figure.savefig(path, dpi=150)
    pyplot.close(figure)
    return path


def _panel(axes: Any, results: Sequence[Result], title: str) -> None:
    vehicles = [r.cell.vehicles for r in results]
    bound = [100 * r.bound_share for r in results]
    axes.plot(vehicles, bound, "k--", linewidth=1.2, label="upper bound")
    for name, colour in zip(reversed([*STRATEGIES]), reversed(_COLOURS), strict=False):
        shares = [100 * _row(r, name).net_kwh / r.plans.ceiling_kwh for r in results]
        axes.plot(vehicles, shares, "o-", color=colour, markersize=3.5, linewidth=1.4, label=name)
    axes.set(xscale="log", xlabel="vehicles a day", title=title)
    axes.set_xticks(vehicles, [f"{count:,}" for count in vehicles], fontsize=8)
    axes.minorticks_off()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#e5e5e5", linewidth=0.6)


def _share(result: Result, row: Row) -> str:
    share = f"{row.net_kwh / result.plans.ceiling_kwh:.1%}"
    return share if _is_fair(row) else rf"{share}\*"


def _is_fair(row: Row) -> bool:
    """Whether no carrier has less than alone."""
    return row.worst_carrier_kwh >= -_NONE_KWH


def _vehicles(result: Result) -> int:
    return result.cell.vehicles
