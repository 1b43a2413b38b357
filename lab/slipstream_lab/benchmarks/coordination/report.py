"""The coordination benchmark's report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from slipstream_cli.tables import markdown_table
from slipstream_lab.benchmarks.aims import Check, report_head, write_report
from slipstream_lab.research.coordination.cells import NONE_KWH, OWN, CellResult, Place
from slipstream_lab.research.coordination.strategies import STRATEGIES

_AIM_SHARE: Final = 0.9
_PLACES: Final[Mapping[Place, str]] = {
    "one": "corridor, one carrier",
    "ten": "corridor, ten carriers",
    "region": "region, ten carriers",
}


def checks(results: Iterable[CellResult]) -> list[Check]:
    """The aims of our own strategy."""
    shares, ahead, worst = [], [], []
    for result in results:
        own = result.row(OWN)
        if result.bounded.bound_kwh > NONE_KWH:
            shares.append(own.net_kwh / result.bounded.bound_kwh)
        rivals = [row.net_kwh for row in result.plans.rows if row.strategy != OWN and row.is_fair]
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
            f"{sum(gap >= -NONE_KWH for gap in ahead)} of {len(ahead)}",
            "all",
            min(ahead) >= -NONE_KWH,
        ),
        Check(
            "worst carrier against driving alone, kWh",
            f"{min(worst):.2f}",
            "≥ 0",
            min(worst) >= -NONE_KWH,
        ),
    ]


def write(folder: Path, results: Sequence[CellResult], about: Mapping[str, object]) -> None:
    """Write report.md and report.json into an existing folder."""
    content = {
        "checks": [asdict(c) for c in checks(results)],
        "results": [asdict(result) for result in results],
    }
    write_report(folder, markdown(results, about), about, content)


def markdown(results: Sequence[CellResult], about: Mapping[str, object]) -> str:
    """The report as people read it."""
    title = "Coordination: share of the drafting ceiling by density"
    lines = report_head(title, about, checks(results))
    for price_kw in dict.fromkeys(r.cell.price_kw for r in results):
        some = [r for r in results if r.cell.price_kw == price_kw]
        lines += ["", f"## Waiting at {price_kw} kW", "", *_net(some), "", *_ours(some)]
    return "\n".join(lines) + "\n"


def _net(results: Iterable[CellResult]) -> list[str]:
    rows = []
    for r in results:
        shares = [_share(r, name) for name in STRATEGIES]
        tight = (
            f"{r.best.net_kwh / r.bounded.bound_kwh:.1%}" if r.bounded.bound_kwh > NONE_KWH else "–"
        )
        bound = f"{r.bound_share:.1%}"
        rows.append((*_cell(r), *shares, bound, tight))
    columns = (*_CELL_COLUMNS, *STRATEGIES, "bound", "best of the bound")
    text = (
        "Net value (drafting less stops and waiting) as a share of the drafting ceiling; \\*: a "
        "carrier has less than alone:"
    )
    return [text, "", markdown_table(columns, rows)]


def _ours(results: Iterable[CellResult]) -> list[str]:
    rows = []
    for r in results:
        own = r.row(OWN)
        rows.append(
            (
                *_cell(r),
                f"{own.outcome.drafting_kwh:.1f}",
                f"{own.outcome.drafting_kwh / r.plans.ceiling_kwh:.1%}",
                f"{own.outcome.stops_kwh:.1f}",
                f"{own.outcome.mean_wait_s:.0f}",
                f"{own.outcome.max_wait_s:.0f}",
                f"{own.outcome.platooned_km / own.outcome.open_km:.1%}",
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


def _cell(result: CellResult) -> tuple[str, str, str]:
    cell = result.cell
    return _PLACES[cell.place], f"{cell.vehicles:,}", f"±{cell.window_min}"


def _share(result: CellResult, strategy: str) -> str:
    share = f"{result.net_share(strategy):.1%}"
    return share if result.row(strategy).is_fair else rf"{share}\*"
