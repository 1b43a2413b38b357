"""The paper's two figures of the day, from ours."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor
from pathlib import Path
from typing import Any, Final

import numpy as np

from slipstream_lab.simulation.evaluation.arms import BASELINE, COOPERATIVE, EVERY_LEVER, SHORTEST
from slipstream_lab.simulation.evaluation.measures import BIN_S, HOUR_S, Array, Evaluation
from slipstream_lab.simulation.evaluation.report.data import courses_of
from slipstream_lab.simulation.evaluation.report.formatting import percent
from slipstream_lab.simulation.scenarios.acceptance import clock

SHOWN: Final = (SHORTEST, BASELINE, COOPERATIVE, EVERY_LEVER)
"""Policies of the hourly figure; the cumulative one leaves out the first."""

_COLOURS: Final = {
    SHORTEST: "#999999",
    BASELINE: "#444444",
    COOPERATIVE: "#0072b2",
    EVERY_LEVER: "#009e73",
}
_LINES: Final = {EVERY_LEVER: (0, (5, 1.5))}
_LABELS: Final = {
    SHORTEST: "A: shortest time",
    BASELINE: "B: the paper's baseline",
    COOPERATIVE: "C: cooperative",
    EVERY_LEVER: "C+: with signal priority",
}


_TICKS_S: Final = (300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 10800.0)


def draw(evaluation: Evaluation, folder: Path) -> tuple[str, ...]:
    """Draw both figures; names of the files.

    Raises:
        ModuleNotFoundError: matplotlib is not installed.
        OSError: a file cannot be written.
    """
    plt = pyplot()
    names = [name for name in SHOWN if name in evaluation]
    if not names:
        return ()
    cumulative(plt, evaluation, [n for n in names if n != SHORTEST], folder / "cumulative.png")
    hourly(plt, evaluation, names, folder / "hourly.png")
    return ("cumulative.png", "hourly.png")


def cumulative(plt: Any, evaluation: Evaluation, names: Sequence[str], path: Path) -> None:
    """Energy so far, and distance in platoons so far, over the day; means and ranges of seeds."""
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(7.2, 5.4), layout="constrained", sharex=True, height_ratios=(2, 1)
    )
    for name in names:
        courses = courses_of(evaluation, name, BIN_S)
        hours = np.concatenate([[evaluation.provenance.begin_s], courses[0].ends_s]) / HOUR_S
        energy = np.array([_so_far(c.energy_kwh) for c in courses])
        platooned = np.array([_so_far(c.platooned_km) for c in courses])
        saved = evaluation.headline(name).saving
        label = _LABELS[name]
        if name != BASELINE and saved is not None:
            label += f" ({percent(saved.mean)} saved at equal travel time)"
        _band(above, hours, energy, name, label)
        if name != BASELINE:
            _band(below, hours, platooned, name, None)
    above.set(ylabel="energy so far, kWh", ylim=(0, None))
    above.legend(frameon=False, loc="lower right")
    below.set(ylabel="platooned so far, km", xlabel="hour of the day", ylim=(0, None))
    _hours(below, evaluation)
    for axes in (above, below):
        tidy(axes)
    figure.savefig(path, dpi=150, metadata={"Software": None})
    plt.close(figure)


def hourly(plt: Any, evaluation: Evaluation, names: Sequence[str], path: Path) -> None:
    """Energy of each hour by policy; means over the seeds, lines from the least to the most."""
    figure, axes = plt.subplots(figsize=(9.0, 4.0), layout="constrained")
    for place, name in enumerate(names):
        courses = courses_of(evaluation, name, HOUR_S)
        ends = courses[0].ends_s / HOUR_S
        starts = np.concatenate([[evaluation.provenance.begin_s / HOUR_S], ends[:-1]])
        middle, width = (starts + ends) / 2, 0.84 / len(names) * (ends - starts)
        at = middle + (place - (len(names) - 1) / 2) * width
        energy = np.array([c.energy_kwh for c in courses])
        axes.bar(at, energy.mean(axis=0), width, color=_COLOURS[name], label=_LABELS[name])
        if len(courses) > 1:
            axes.vlines(at, energy.min(axis=0), energy.max(axis=0), color="black", linewidth=0.7)
    axes.set(ylabel="energy in the hour, kWh", xlabel="hour of the day")
    _hours(axes, evaluation)
    tidy(axes)
    axes.legend(frameon=False, ncols=len(names), loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(path, dpi=150, metadata={"Software": None})
    plt.close(figure)


def _so_far(values: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(values)])


def _band(axes: Any, hours: Array, values: Array, name: str, label: str | None) -> None:
    """The mean of rows as a line, their range as a band."""
    colour, line = _COLOURS[name], _LINES.get(name, "-")
    axes.plot(hours, values.mean(axis=0), color=colour, linestyle=line, linewidth=1.6, label=label)
    if len(values) > 1:
        axes.fill_between(
            hours, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.2, linewidth=0
        )


def _hours(axes: Any, evaluation: Evaluation) -> None:
    """Ticks at round times of the simulated part of the day."""
    begin_s, end_s = evaluation.provenance.begin_s, evaluation.provenance.end_s
    step_s = next((s for s in _TICKS_S if end_s - begin_s <= 8 * s), _TICKS_S[-1])
    times = [t * step_s for t in range(ceil(begin_s / step_s), floor(end_s / step_s) + 1)]
    words = [f"{t / HOUR_S:g}" if step_s >= HOUR_S else clock(t) for t in times]
    axes.set_xticks([t / HOUR_S for t in times], words)
    axes.set_xlim(begin_s / HOUR_S, end_s / HOUR_S)


def tidy(axes: Any) -> None:
    """Axes without a frame, with a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_axisbelow(True)
    axes.grid(axis="y", color="#e5e5e5", linewidth=0.6)


def pyplot() -> Any:
    """matplotlib's pyplot without a display."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot
