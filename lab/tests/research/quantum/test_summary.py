from __future__ import annotations

import math
from typing import Any

import pytest

from slipstream_lab.research.quantum.paper import LC_QAOA_DEVICE
from slipstream_lab.research.quantum.report import Table, as_json, as_markdown
from slipstream_lab.research.quantum.summary import Line, spread, summarise


def record(feasible: float, control: float, best: float | None) -> dict[str, Any]:
    """A quantum record of few fields."""
    return {
        "wall_s": 2.0,
        "p_feasible": feasible,
        "p_optimal": None,
        "two_qubit_depth": 8,
        "best_cost": best,
        "best_cost_raw": None if best is None else 0.9 * best,
        "optimal_cost": -2.0,
        "uniform_exact": {"p_feasible": 0.01, "p_optimal": 0.001},
        "controls": {"uniform bits": {"p_feasible": control}},
        "added": {
            "uniform bits": {
                "p_feasible": {"value": feasible - control, "standard_error": 0.03},
            }
        },
    }


def test_spread_is_mean_and_sample_deviation() -> None:
    """Unknown values are left out; one value has no deviation; none is no spread."""
    found = spread([1.0, None, 3.0])
    assert found is not None
    assert (found.mean, found.least, found.most, found.count) == (2.0, 1.0, 3.0, 2)
    assert found.deviation == pytest.approx(math.sqrt(2))
    alone = spread([4.0])
    assert alone is not None
    assert alone.deviation == 0.0
    assert spread([None]) is None


def test_a_line_holds_means_hits_and_what_is_added() -> None:
    """Means over instances, how often the optimum was found, differences with both errors."""
    line = summarise(
        "k",
        "LC-QAOA",
        "noise-model",
        LC_QAOA_DEVICE[2],
        [record(0.4, 0.1, -2.0 + 1e-12), record(0.2, 0.1, -1.0), record(0.3, 0.1, None)],
    )
    assert line.figures["p_feasible"].mean == pytest.approx(0.3)
    assert "p_optimal" not in line.figures
    assert (line.raw_hits, line.hits) == (0, 1)
    assert line.gap is not None
    assert (line.gap.least, line.gap.most) == (0.0, 0.5)
    assert line.raw_gap is not None
    assert (line.raw_gap.least, line.raw_gap.most) == (pytest.approx(0.1), pytest.approx(0.55))
    assert line.figures["best_cost"].mean == pytest.approx(-1.5)
    assert line.uniform == {"p_feasible": 0.01, "p_optimal": 0.001}
    (added,) = line.added
    assert added.control_mean == pytest.approx(0.1)
    assert added.value == pytest.approx(0.2)
    assert added.shot_error == pytest.approx(0.03 / math.sqrt(3))
    assert added.spread_error == pytest.approx(0.1 / math.sqrt(3))


def test_a_record_without_samples_does_not_hide_the_controls_of_others() -> None:
    """Differences are over the records that have them, wherever those stand."""
    empty = record(0.0, 0.0, None) | {"p_feasible": None, "controls": {}, "added": {}}
    line = summarise("k", "t", "simulated", None, [empty, record(0.4, 0.1, -2.0)])
    (added,) = line.added
    assert (added.value, added.control_mean) == (pytest.approx(0.3), pytest.approx(0.1))


def test_tables_show_the_papers_figures_and_the_mark() -> None:
    """Ours beside the paper's, how they came about, and why a row is empty."""
    records = [record(0.4, 0.1, -2.0), record(0.2, 0.1, -1.0)]
    full = summarise("k", "LC-QAOA p = 2", "noise-model", LC_QAOA_DEVICE[2], records)
    empty = Line("i", "Iskay", "hardware", None, {}, *(None,) * 4, (), reason="no account")
    text = as_markdown([Table("hardware", "Hardware", (full, empty))], ["a note"])
    (row,) = [line for line in text.splitlines() if line.startswith("| LC-QAOA") and "56" in line]
    for said in ("noise-model", "30.0 ± 14.1", "38.6", "31.34", "1 of 2", "-1.5000", "-2.334"):
        assert said in row
    assert "10.00: +20.00" in text
    assert "- Iskay: no account" in text
    assert "- a note" in text
    data = as_json([Table("hardware", "Hardware", (full, empty))], ["a note"], seed=1)
    first, second = data["tables"]["hardware"]
    assert first["figures"]["p_feasible"]["mean"] == pytest.approx(0.3)
    assert first["paper"]["p_feasible"] == 0.386
    assert (first["mark"], second["reason"], data["seed"]) == ("noise-model", "no account", 1)
