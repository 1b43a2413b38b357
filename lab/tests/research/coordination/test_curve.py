"""The curve: what is planned for it, its tables and its picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from lab.tests.research.coordination.fakes import result
from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream.errors import InputError
from slipstream_lab.research.coordination import curve, picture
from slipstream_lab.research.coordination.cells import CellResult, CoordinationCell
from slipstream_lab.research.coordination.curve import (
    as_data,
    curve_cells,
    plan_missing,
    write_curve,
)
from slipstream_lab.research.coordination.strategies import STRATEGIES
from slipstream_lab.simulation.evaluation.arms import choose
from slipstream_lab.simulation.evaluation.measures import Evaluation, collect
from slipstream_lab.simulation.evaluation.report import pyplot
from slipstream_lab.simulation.evaluation.runs import ArmStore

CELLS = curve_cells((20, 500), (1, 2))


@pytest.fixture
def results() -> list[CellResult]:
    """The second seed saves 2 kWh of 10 more."""
    return [result(2.0 * c.seed, 1.0, 6.0, cell=c) for c in CELLS]


@pytest.fixture
def driven(tmp_path: Path) -> Mapping[int, Evaluation]:
    """One density."""
    with ArmStore(tmp_path / "arms", GROUND, "code") as store:
        for policy in choose("B,C"):
            for seed in (1, 2):
                store.put(policy, seed, make_arm(policy, seed))
        return {29: collect(store, GROUND, (1, 2))}


def test_cells_are_all_prices_carriers_and_seeds() -> None:
    """Densities in turn, so that an interrupted run has whole ones."""
    assert len(CELLS) == len(set(CELLS)) == 2 * 2 * 2 * 2
    assert [cell.vehicles for cell in CELLS] == [20] * 8 + [500] * 8
    assert {(c.place, c.price_kw, c.seed, c.window_min) for c in CELLS} == {
        (place, price, seed, 10) for place in ("one", "ten") for price in (0, 27) for seed in (1, 2)
    }


def test_tables_have_means_spreads_and_who_loses(tmp_path: Path, results: list[CellResult]) -> None:
    """A row for each number of carriers and density; a loser's strategy has its mark."""
    results[0] = result(2.0, 1.0, 6.0, worst_kwh=-0.5, cell=CELLS[0])
    write_curve(tmp_path, results, {})
    text = (tmp_path / "density.md").read_text()
    free, priced = text.split("## Planned only: waiting at ")[1:]
    assert free.startswith("0 kW, arrival within ±10 min")
    assert priced.startswith("27 kW")
    rows = [line for line in free.splitlines() if "carrier" in line and "| 2 |" in line]
    assert [row.split(" | ")[:2] for row in rows] == [
        ["| one carrier", "20"],
        ["| one carrier", "500"],
        ["| ten carriers", "20"],
        ["| ten carriers", "500"],
    ]
    # 2 and 4 of 10 kWh: mean 30 %, standard deviation 14.1; 2/6 and 4/6 of the bound.
    assert r"30.0 ± 14.1 %\* | 60.0 % | 50.0 ± 23.6 %" in rows[0]
    assert all("30.0 ± 14.1 % | 60.0 %" in row for row in rows[1:])
    assert "driven" not in text
    (first, *_) = as_data(results)
    share = first["share_of_ceiling"]["local search"]
    assert (first["seeds"], share["mean"]) == ([1, 2], pytest.approx(0.3))


def test_what_was_driven_stands_beside_with_its_differences(
    tmp_path: Path, results: list[CellResult], driven: Mapping[int, Evaluation]
) -> None:
    """Same input, same bytes, of the picture too."""
    assert write_curve(tmp_path, results, driven) is None
    text = (tmp_path / "density.md").read_text()
    assert "Driven: share of the drafting ceiling by density" in text
    assert "What differs between planned only and driven" in text
    image = (tmp_path / "density.png").read_bytes()
    assert image[:4] == b"\x89PNG"
    write_curve(tmp_path, list(reversed(results)), driven)
    assert (tmp_path / "density.md").read_text() == text
    assert (tmp_path / "density.png").read_bytes() == image


def test_what_is_driven_alone_has_its_picture(
    tmp_path: Path, driven: Mapping[int, Evaluation]
) -> None:
    """Nothing of the densities that were asked for is planned yet."""
    assert write_curve(tmp_path, [], driven) is None
    assert (tmp_path / "density.md").read_text().startswith("## Driven: share")
    assert (tmp_path / "density.png").is_file()


def _series(axes: Any) -> dict[str, list[float]]:
    """Means by label."""
    handles, labels = axes.get_legend_handles_labels()
    return {
        label: list(handle.lines[0].get_ydata())
        for handle, label in zip(handles, labels, strict=True)
    }


def test_the_picture_has_every_series(
    results: list[CellResult], driven: Mapping[int, Evaluation]
) -> None:
    """Each panel of planned ones has all strategies and the bound, the last one what was driven;
    the legend names all of them."""
    plt = pyplot()
    drawn = picture.figure(plt, results, driven)
    panels = {axes.get_title(): axes for axes in drawn.axes if axes.get_title()}
    *planned, rounds = panels.values()
    assert list(panels)[:2] == [
        "one carrier, waiting is free",
        "ten carriers, waiting is free",
    ]
    assert len(planned) == 4
    ready, *rivals, own = STRATEGIES
    lines = {"upper bound", *rivals, f"{own} (ours)", f"{ready} (nobody waits)"}
    for axes in planned:
        series = _series(axes)
        assert set(series) == lines
        assert series["local search (ours)"] == [pytest.approx(30.0)] * 2
        assert series["upper bound"] == [pytest.approx(60.0)] * 2
    assert set(_series(rounds)) == {"planned by the dispatcher", "driven in SUMO"}
    shares = driven[29].figure("C", lambda m: 100 * m.drafted_kwh / m.ceiling_kwh)
    assert shares is not None
    assert _series(rounds)["driven in SUMO"] == [pytest.approx(shares.mean)]
    legends = [a for axes in drawn.axes for a in axes.get_children() if hasattr(a, "get_texts")]
    named = [text.get_text() for legend in legends for text in legend.get_texts()]
    assert sorted(named) == sorted([*lines, "planned by the dispatcher", "driven in SUMO"])
    assert len({axes.get_xlim() for axes in panels.values()}) == 1
    plt.close(drawn)
    without = picture.figure(plt, results, {})
    assert sum(bool(axes.get_title()) for axes in without.axes) == 4
    plt.close(without)


def test_an_interrupted_plan_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells that are there are not planned again; progress ends at all of what was missing."""
    done: list[CoordinationCell] = []
    monkeypatch.setattr(curve, "found", lambda cell, _: cell if cell in done else None)

    def measured(cell: CoordinationCell, *_: object) -> None:
        if len(done) == 3 and not again:
            raise KeyboardInterrupt
        done.append(cell)

    monkeypatch.setattr(curve, "measured", measured)
    steps: list[tuple[int, int]] = []
    again = False
    with pytest.raises(KeyboardInterrupt):
        plan_missing(CELLS, tmp_path, 1, lambda *step: steps.append(step))
    assert steps[-1][0] < steps[-1][1]
    again = True
    assert plan_missing(CELLS, tmp_path, 1, lambda *step: steps.append(step)) == 3
    assert done == CELLS
    assert steps[-1][0] == steps[-1][1]


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    """By the option that gave it."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out"):
        plan_missing(CELLS[:1], tmp_path / "file", 1, lambda *_: None)
