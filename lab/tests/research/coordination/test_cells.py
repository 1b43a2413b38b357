"""Stored cells: found again, made anew where they are of something else."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from slipstream_lab.research.coordination import cells
from slipstream_lab.research.coordination.bound import Bound
from slipstream_lab.research.coordination.case import CoordinationCase
from slipstream_lab.research.coordination.cells import CoordinationCell, found, measured
from slipstream_lab.research.coordination.plan import Plan, undelayed

CELL = CoordinationCell("one", 3, 10, 0)


def silent(_: str) -> None:
    """Say nothing."""


@pytest.fixture
def planned(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was planned; the plan and the bound take no time."""
    done: list[str] = []

    def plan(case: CoordinationCase) -> Plan:
        done.append(case.freight.name)
        return undelayed(case)

    monkeypatch.setattr(cells, "STRATEGIES", {"as ready": plan})
    monkeypatch.setattr(cells, "upper_bound", lambda case: Bound(case.ceiling_kwh, 2.0))
    return done


def test_a_cell_is_planned_once(tmp_path: Path, planned: list[str]) -> None:
    """What comes back from the folder is what was put there; other seeds are other trips."""
    assert found(CELL, tmp_path) is None
    first = measured(CELL, tmp_path, silent)
    assert found(CELL, tmp_path) == first == measured(CELL, tmp_path, silent)
    assert len(planned) == 1
    other = measured(replace(CELL, seed=2), tmp_path, silent)
    assert other.plans.ceiling_kwh != first.plans.ceiling_kwh
    assert len(planned) == 2


def _set(key: str, value: object) -> Callable[[str], str]:
    return lambda text: json.dumps({**json.loads(text), key: value})


@pytest.mark.parametrize(
    "change",
    [
        _set("format", cells.FORMAT + 1),
        _set("code", "another"),
        lambda text: text[: len(text) // 2],
        lambda text: "[]",
        lambda text: text.replace('"ceiling_kwh"', '"ceiling"').replace('"bin_s"', '"bin"'),
    ],
    ids=["format", "code", "half", "list", "field"],
)
def test_a_file_of_something_else_is_made_anew(
    tmp_path: Path, planned: list[str], change: Callable[[str], str]
) -> None:
    """Another format or code, or damaged."""
    first = measured(CELL, tmp_path, silent)
    path = tmp_path / f"{CELL.name}.json"
    path.write_text(change(path.read_text()))
    assert found(CELL, tmp_path) is None
    again = measured(CELL, tmp_path, silent)
    assert found(CELL, tmp_path) == again
    assert again.plans.rows[0].outcome == first.plans.rows[0].outcome
    assert len(planned) == 2


def test_a_window_longer_than_any_wait_that_pays_is_planned_once(
    tmp_path: Path, planned: list[str]
) -> None:
    """At a price the shorter cell is taken for it; where waits are free each window is its own."""
    priced = CoordinationCell("one", 20, 10, 27)
    assert measured(priced, tmp_path, silent).cell == priced
    assert found(replace(priced, window_min=30), tmp_path) is not None
    assert found(replace(priced, window_min=1), tmp_path) is None
    measured(CELL, tmp_path, silent)
    assert found(replace(CELL, window_min=30), tmp_path) is None


def test_a_plan_above_the_bound_is_an_error(
    tmp_path: Path, planned: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of both is wrong."""
    monkeypatch.setattr(cells, "upper_bound", lambda case: Bound(-1.0, 2.0))
    with pytest.raises(RuntimeError, match="as ready is above the bound"):
        measured(CELL, tmp_path, silent)
