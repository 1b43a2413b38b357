"""The paper's two figures, from tables of a few rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from slipstream_lab.research.quantum import picture
from slipstream_lab.research.quantum.paper import LC_QAOA_DEVICE
from slipstream_lab.research.quantum.report import Table
from slipstream_lab.research.quantum.run import HARDWARE, MITIGATION, SWEEP
from slipstream_lab.research.quantum.summary import Line, summarise
from slipstream_lab.simulation.evaluation.report import pyplot


def line(p: int, mark: str, feasible: float) -> Line:
    """LC-QAOA at a depth, of two instances."""
    records: list[dict[str, Any]] = [
        {
            "p_feasible": share,
            "p_optimal": 0.0,
            "best_cost": 1.0,
            "best_cost_raw": 1.1,
            "optimal_cost": 1.0,
            "uniform_exact": {"p_feasible": 2e-4, "p_optimal": 3e-5},
        }
        for share in (feasible, 3 * feasible)
    ]
    paper = LC_QAOA_DEVICE[p]
    return summarise(f"lc-qaoa/trained/p{p}/{mark}", f"LC-QAOA, p = {p}", mark, paper, records)


LINES = (line(1, "noise-model", 0.001), line(2, "noise-model", 0.002), line(1, "simulated", 0.01))


def points(axes: Any) -> set[tuple[float, float]]:
    """Data of all lines, rounded."""
    return {
        (round(float(x), 6), round(float(y), 6))
        for drawn in axes.get_lines()
        for x, y in zip(drawn.get_xdata(), drawn.get_ydata(), strict=True)
    }


@pytest.mark.slow
def test_shares_stand_beside_the_papers_and_uniform_bits() -> None:
    """Means over instances; a share of 0 stands on the axis' lower end."""
    plt = pyplot()
    drawn = picture.shares_figure(plt, Table(HARDWARE, "t", LINES))
    feasible, optimal = drawn.axes
    assert {(0.002, 0), (0.004, 1), (0.02, 2), (0.125, 0), (0.386, 1)} <= points(feasible)
    assert {(picture.LEAST, 0), (0.028, 0), (0.142, 1)} <= points(optimal)
    assert (2e-4, 0) in points(feasible)
    plt.close(drawn)


@pytest.mark.slow
def test_depth_has_a_series_for_each_way(tmp_path: Path) -> None:
    """With noise and without beside the paper's sweep; the best raw shot's gap in per cent."""
    plt = pyplot()
    drawn = picture.depth_figure(plt, Table(SWEEP, "t", LINES))
    gap = [y for _, y in points(drawn.axes[2])]
    for percent in (10.0, 7.147):
        assert any(y == pytest.approx(percent, abs=1e-3) for y in gap)
    assert {(1, 0.125), (2, 0.386)} <= points(drawn.axes[0])
    plt.close(drawn)
    made = picture.draw([Table(name, "t", LINES) for name in (SWEEP, MITIGATION)], tmp_path)
    assert [path.name for path in made] == ["quantum-depth.png"]
    assert made[0].stat().st_size > 10_000
