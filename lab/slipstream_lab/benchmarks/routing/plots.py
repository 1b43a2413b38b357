"""The plots of the report: time against fleet size, and savings against the rivals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from slipstream_lab.benchmarks.routing.figures import (
    CityRun,
    log_slope,
    medians_by_size,
    saved_share,
)
from slipstream_lab.benchmarks.routing.report import MAX_SLOPE, RoutingResults
from slipstream_lab.simulation.evaluation.report import pyplot

_BLUE: Final = "#0072b2"
_ORANGE: Final = "#d55e00"
_GREEN: Final = "#009e73"
_PINK: Final = "#cc79a7"
_GREY: Final = "#777777"


def draw(results: RoutingResults, folder: Path) -> list[Path]:
    """Draw what there are figures for; the pictures' paths."""
    drawn = []
    if len({run.vehicles for run in results.fixed}) > 1:
        drawn.append(folder / "routing-scaling.png")
        scaling(results, drawn[-1])
    if results.rivals:
        drawn.append(folder / "routing-rivals.png")
        rivals(results.rivals, drawn[-1])
    return drawn


def scaling(results: RoutingResults, path: Path) -> None:
    """Time of a cycle against fleet size on logarithmic axes, with fitted slopes."""
    plt = pyplot()
    figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    times = medians_by_size(results.fixed)
    sizes, seconds = zip(*times, strict=True)
    label = f"fixed network: slope {log_slope(sizes, seconds):.2f}"
    axes.plot(sizes, seconds, "o-", color=_BLUE, linewidth=1.5, label=label)
    first = times[0]
    fleets = [size for size, _ in times]
    limit = [first[1] * (size / first[0]) ** MAX_SLOPE for size in fleets]
    axes.plot(fleets, limit, "--", color=_GREY, linewidth=1, label=f"slope {MAX_SLOPE:g}, the aim")
    axes.set(
        xscale="log", yscale="log", xlabel="vehicles (five stops each)",
        ylabel="time of a whole cycle, s",
    )  # fmt: skip
    axes.set_xticks(fleets, [f"{size:d}" for size in fleets])
    axes.minorticks_off()
    low, high = axes.get_ylim()
    ticks = [t for t in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if low <= t <= high]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    _tidy(axes)
    axes.grid(color="#e5e5e5", linewidth=0.6)
    axes.legend(frameon=False, loc="upper left")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def rivals(runs: Sequence[CityRun], path: Path) -> None:
    """Objective against both rivals city by city, and where physical energy is saved."""
    plt = pyplot()
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(9.0, 4.2), layout="constrained", width_ratios=(1, 1.7)
    )
    against = (
        ("the VRP without\nplatooning", [saved_share(r.objective_kwh, r.base_kwh) for r in runs]),
        ("route-then-\nschedule", [saved_share(r.objective_kwh, r.greedy_kwh) for r in runs]),
    )
    spots = np.linspace(-0.15, 0.15, len(runs)) if len(runs) > 1 else np.zeros(1)
    for position, (_, shares) in enumerate(against):
        in_order = 100 * np.sort(shares)
        left.plot(position + spots, in_order, "o", color=_BLUE, markersize=4)
        mean = float(in_order.mean())
        left.plot([position - 0.28, position + 0.28], [mean, mean], color=_ORANGE, linewidth=2)
        left.annotate(
            f"mean {mean:.2f} %", (position + 0.3, mean), color=_ORANGE, va="center", fontsize=9
        )
    left.set_xticks(range(len(against)), [name for name, _ in against])
    left.set(xlim=(-0.5, 1.95), ylabel="objective below that of the rival, %")
    left.axhline(0, color=_GREY, linewidth=0.8)
    _tidy(left)

    parts = (
        ("distance", _GREEN, [r.saved_distance_kwh for r in runs]),
        ("drag", _BLUE, [r.saved_drag_kwh for r in runs]),
        ("acceleration", _PINK, [r.saved_acceleration_kwh for r in runs]),
    )
    base = np.array([r.base_driven_kwh for r in runs])
    above, below = np.zeros(len(runs)), np.zeros(len(runs))
    places = np.arange(len(runs))
    for name, colour, values in parts:
        share = 100 * np.array(values) / base
        bottom = np.where(share >= 0, above, below)
        right.bar(places, share, bottom=bottom, color=colour, width=0.75, label=name)
        above, below = above + np.maximum(share, 0), below + np.minimum(share, 0)
    right.plot(places, above + below, "_", color="black", markersize=9, label="sum")
    right.set_xticks(places, [str(r.seed) for r in runs], fontsize=8)
    right.set(xlabel="city (seed)", ylabel="physical energy saved, % of the VRP's")
    right.axhline(0, color=_GREY, linewidth=0.8)
    _tidy(right)
    right.legend(frameon=False, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _tidy(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
