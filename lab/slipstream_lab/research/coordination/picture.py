"""The picture of the curve."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from slipstream_lab.research.coordination.cells import CellResult, Place
from slipstream_lab.research.coordination.strategies import STRATEGIES
from slipstream_lab.simulation.evaluation.measures import Evaluation, SeedSpread
from slipstream_lab.simulation.evaluation.report import density_shares, pyplot, tidy

PRICES_KW: Final = (0, 27)
"""Of waiting: free, and what slower driving would save the paper's car at 30 m/s."""
PLACES: Final[Mapping[Place, str]] = MappingProxyType({"one": "one carrier", "ten": "ten carriers"})
BOUND: Final = "upper bound"
ROUNDS_PLANNED: Final = "planned by the dispatcher"
ROUNDS_DRIVEN: Final = "driven in SUMO"

_STYLES: Final[Mapping[str, Mapping[str, Any]]] = {
    BOUND: {"color": "black", "linestyle": (0, (4, 2)), "linewidth": 1.3},
    "local search": {"color": "#0072b2", "marker": "o", "linewidth": 2.0, "markersize": 5.0},
    "pairwise leaders": {"color": "#009e73", "marker": "s", "linestyle": (0, (6, 1.5))},
    "hub waiting": {"color": "#d55e00", "marker": "D", "linestyle": (0, (3, 1, 1, 1))},
    "threshold": {"color": "#cc79a7", "marker": "^", "linestyle": (0, (2, 1))},
    "as ready": {"color": "#777777", "marker": "x", "linestyle": (0, (1, 1.2))},
    ROUNDS_PLANNED: {"color": "#777777", "marker": "v", "markerfacecolor": "white"},
    ROUNDS_DRIVEN: {"color": "black", "marker": "*", "markersize": 9.0},
}
"""By colours that are told apart by colour-blind readers, and by markers and dashes in grey."""
_LINES: Final = {"linewidth": 1.2, "markersize": 4.0, "capsize": 2.0, "elinewidth": 0.8}
_EXPLAINED: Final = {"local search": "local search (ours)", "as ready": "as ready (nobody waits)"}
_MARGIN: Final = 1.3
_DODGE: Final = 1.03
"""Series stand so far beside each other that bars of spread do not cover each other."""


def by_density(results: Iterable[CellResult]) -> dict[int, list[CellResult]]:
    """Results by vehicles a day, rising, in the order of the seeds."""
    found: dict[int, list[CellResult]] = {}
    for result in sorted(results, key=lambda r: (r.cell.vehicles, r.cell.seed)):
        found.setdefault(result.cell.vehicles, []).append(result)
    return found


def shares(results: Sequence[CellResult]) -> dict[str, SeedSpread | None]:
    """Net value as a share of the ceiling over the seeds of one density, by strategy."""
    return {name: SeedSpread.over([r.net_share(name) for r in results]) for name in STRATEGIES}


def draw(results: Sequence[CellResult], driven: Mapping[int, Evaluation], path: Path) -> None:
    """Draw the curve; see `figure`.

    Raises:
        ModuleNotFoundError: matplotlib is not installed.
        OSError: the file cannot be written.
    """
    plt = pyplot()
    drawn = figure(plt, results, driven)
    drawn.savefig(path, dpi=150, metadata={"Software": None})
    plt.close(drawn)


def figure(plt: Any, results: Sequence[CellResult], driven: Mapping[int, Evaluation]) -> Any:
    """A panel for each price of waiting and number of carriers, and one of what was driven.
    `driven`: evaluations by vehicles a day; none: no panel of them.
    """
    drawn, panels = plt.subplots(
        2, 3, figsize=(9.2, 6.2), layout="constrained", sharey=True, width_ratios=(1, 1, 0.95)
    )
    densities = sorted({r.cell.vehicles for r in results} or driven)
    for (row, price_kw), (column, place) in product(enumerate(PRICES_KW), enumerate(PLACES)):
        some = [r for r in results if (r.cell.place, r.cell.price_kw) == (place, price_kw)]
        waiting = "waiting is free" if price_kw == 0 else f"waiting costs {price_kw} kW"
        _panel(panels[row, column], _planned(some), densities, f"{PLACES[place]}, {waiting}")
    drawn.suptitle(
        "100 %: every vehicle follows another one all the way. Bars: standard deviation over days",
        fontsize=10,
    )
    for axes in panels[:, 0]:
        axes.set_ylabel("share of the drafting ceiling, %")
    legend, last = panels[:, -1]
    legend.axis("off")
    legend.add_artist(_legend(legend, panels[0, 0], "planned only", 1.0))
    if driven:
        planned, reached = density_shares(driven)
        rounds = {ROUNDS_PLANNED: planned, ROUNDS_DRIVEN: reached}
        _panel(last, rounds, densities, "delivery rounds in waves")
        _legend(legend, last, "delivery rounds in waves", 0.3)
    else:
        last.axis("off")
    # Equal axes, so that panels compare.
    shown = [*densities, *driven]
    for axes in panels.flat:
        axes.set_xlim(min(shown) / _MARGIN, max(shown) * _MARGIN)
    return drawn


def _legend(at: Any, of: Any, title: str, top: float) -> Any:
    """A legend beside the data, of what is in other axes."""
    handles, labels = of.get_legend_handles_labels()
    return at.legend(
        handles,
        labels,
        title=title,
        loc="upper left",
        bbox_to_anchor=(0.0, top),
        frameon=False,
        alignment="left",
    )


def _planned(results: Sequence[CellResult]) -> dict[str, dict[int, SeedSpread | None]]:
    """Series by label, by vehicles a day."""
    found: dict[str, dict[int, SeedSpread | None]] = {
        name: {} for name in (BOUND, *reversed(list(STRATEGIES)))
    }
    for vehicles, cells in by_density(results).items():
        found[BOUND][vehicles] = SeedSpread.over([r.bound_share for r in cells])
        for name, spread in shares(cells).items():
            found[name][vehicles] = spread
    return found


def _panel(
    axes: Any,
    series: Mapping[str, Mapping[int, SeedSpread | None]],
    densities: Sequence[int],
    title: str,
) -> None:
    """Series with bars of spread over a logarithmic axis of densities."""
    for number, (label, spreads) in enumerate(series.items()):
        known = {n: spread for n, spread in spreads.items() if spread is not None}
        at = [n * _DODGE ** (number - len(series) / 2) for n in known]
        means = [100 * spread.mean for spread in known.values()]
        errors = [100 * (spread.deviation or 0.0) for spread in known.values()]
        axes.errorbar(
            at, means, errors, label=_EXPLAINED.get(label, label), **{**_LINES, **_STYLES[label]}
        )
    axes.set_title(title, fontsize=10)
    axes.set(xscale="log", xlabel="vehicles a day", ylim=(-2, 100))
    axes.set_xticks(densities, [str(n) for n in densities], fontsize=8)
    axes.minorticks_off()
    tidy(axes)
