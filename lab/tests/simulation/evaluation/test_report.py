"""What an evaluation writes."""

from __future__ import annotations

import csv
import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.arms import POLICIES, choose
from slipstream_lab.simulation.evaluation.measures.evaluation import Evaluation, collect
from slipstream_lab.simulation.evaluation.report import files as writing
from slipstream_lab.simulation.evaluation.report.files import write_results
from slipstream_lab.simulation.evaluation.report.markdown import headlines, terminal_summary
from slipstream_lab.simulation.evaluation.runs.run import record_wall_time
from slipstream_lab.simulation.evaluation.runs.store import ArmStore
from slipstream_lab.simulation.fleet.safety import FleetSafety

SEEDS = (1, 2, 3)


def fill(folder: Path, policies: tuple[Policy, ...], code: str = "code", **changes: object) -> None:
    """Store made-up arms."""
    with ArmStore(folder, GROUND, code) as store:
        for policy in policies:
            for seed in SEEDS:
                store.put(policy, seed, make_arm(policy, seed, **changes))  # type: ignore[arg-type]


def read(folder: Path) -> Evaluation:
    """What is stored there."""
    with ArmStore(folder, GROUND, "code") as store:
        return collect(store, GROUND, SEEDS)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of an evaluation with every arm, fit but for one seed of one arm."""
    folder = tmp_path_factory.mktemp("whole")
    fill(folder, tuple(POLICIES.values()))
    with ArmStore(folder, GROUND, "code") as store:
        stops = FleetSafety(emergency_stops=2)
        broken = make_arm(POLICIES["only-coasting"], 2, emergency_stops=2, safety=stops)
        store.put(POLICIES["only-coasting"], 2, broken)
        blocked = make_arm(POLICIES["only-departures"], 3, teleports=15)
        store.put(POLICIES["only-departures"], 3, blocked)
    assert write_results(folder, read(folder)) is None
    return folder


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes a second, which tables need not."""
    monkeypatch.setattr(writing, "draw", lambda evaluation, folder: ())


def row(text: str, title: str, first: str) -> list[str]:
    """The cells of a row of the report's table of that title."""
    (section,) = re.findall(rf"## {re.escape(title)}\n(.*?)(?=\n## |\Z)", text, re.DOTALL)
    (line,) = re.findall(rf"^\| {re.escape(first)} \|.*$", section, re.MULTILINE)
    return [cell.strip() for cell in line.strip("|").split("|")]


@pytest.mark.long
def test_the_papers_tables_stand_beside_ours(whole: Path) -> None:
    """Its figures as published, ours as summed from the files."""
    text = (whole / "report.md").read_text()
    day = "The day, beside the paper's"
    assert row(text, day, "distance, km")[1:3] == ["1,420.5", "1,385.2"]
    assert row(text, day, "travel time, h")[1:3] == ["48.2", "42.1"]
    assert row(text, day, "platooned, km")[1:3] == ["0.0", "682.4"]
    assert row(text, day, "platooned, share of the distance")[2] == "49.3 %"
    energy = row(text, day, "energy, kWh")
    assert energy[1:3] == ["358.4", "292.1"]
    assert row(text, day, "energy saved at its own travel time")[2] == "18.5 %"
    kwh = [sum(leg.driven.total_kwh for leg in make_arm(POLICIES["B"], s).legs) for s in SEEDS]
    assert energy[4].startswith(f"{sum(kwh) / 3:.1f} ± ")
    noise = row(text, "Noise on the features", "30%")
    assert (noise[1], noise[3], noise[5], noise[7]) == ("82.1 %", "562.9", "301.2", "16.0 %")


def test_waits_stand_beside_the_time_on_the_road(whole: Path) -> None:
    """Mean of all legs, at the depot, at stops, the longest, and what travel time they make."""
    waits = row((whole / "report.md").read_text(), "Waits", "C")
    legs = [leg for s in SEEDS for leg in make_arm(POLICIES["C"], s).legs]
    hours = [
        sum(end - begin for begin, end in times) / 3600 / len(SEEDS)
        for times in (
            [(leg.departed_s, leg.arrived_s) for leg in legs],
            [(leg.ready_s, leg.arrived_s) for leg in legs],
        )
    ]
    assert waits[1:5] == ["1", "1", "–", "1"]
    assert [cell.split()[0] for cell in waits[5:7]] == [f"{h:.2f}" for h in hours]


def test_every_table_names_its_sources(whole: Path) -> None:
    """Each section with numbers says which files they come from, and each of these exists."""
    text = (whole / "report.md").read_text()
    sections = text.split("\n## ")[1:-1]
    assert len(sections) >= 10
    for section in sections:
        assert "Source: " in section, section.splitlines()[0]
    files = set(re.findall(r"`(arms/[^`{]+\.json)`", text)) - {"arms/ARM-SEED.json"}
    assert files <= {f"arms/{path.name}" for path in (whole / "arms").glob("*.json")}


def test_a_broken_arm_is_refused_in_words_and_counts_nowhere(whole: Path) -> None:
    """Its seed is left out of the means, its row says why."""
    text = (whole / "report.md").read_text()
    assert "only-coasting, seed 2, is refused: 2 emergency stops of the fleet" in text
    assert row(text, "Arms", "only-coasting")[1] == "1, 3"
    with (whole / "arms.csv").open() as file:
        rows = {(r["arm"], r["seed"]): r for r in csv.DictReader(file)}
    assert rows["only-coasting", "2"]["refused"] == "2 emergency stops of the fleet"
    assert rows["only-coasting", "2"]["saving_at_equal_time"] == ""
    kept = [float(rows["only-coasting", seed]["energy_kwh"]) for seed in ("1", "3")]
    summary = json.loads((whole / "report.json").read_text())
    mean = summary["arms"]["only-coasting"]["figures"]["energy_kwh"]["mean"]
    assert mean == pytest.approx(sum(kept) / 2)
    assert summary["refused"] == [
        {"arm": "only-coasting", "seed": 2, "faults": ["2 emergency stops of the fleet"]}
    ]


@pytest.mark.long
def test_blocked_traffic_of_others_is_a_warning(whole: Path) -> None:
    """Its arm counts, its row of the table of safety has others' teleports apart."""
    text = (whole / "report.md").read_text()
    assert "- seed 3: in 1 arms SUMO teleported more than 1% of the others" in text
    assert "(up to 15 of 1000 trips)" in text
    assert "| only-departures | 3 | 0 + 0 | 0 + 0 | 0 + 15 |" in text
    assert row(text, "Arms", "only-departures")[1] == "1, 2, 3"
    (doubtful,) = json.loads((whole / "report.json").read_text())["doubtful"]
    assert [doubtful[key] for key in ("seed", "teleports", "trips")] == [3, 15, 1000]


def test_the_figures_data_end_at_the_days_energy(whole: Path) -> None:
    """The last line so far is the arm's energy, and pictures are there."""
    with (whole / "cumulative.csv").open() as file:
        rows = list(csv.DictReader(file))
    summary = json.loads((whole / "report.json").read_text())
    for name in ("B", "C", "C+"):
        last = [r for r in rows if r["arm"] == name][-1]
        figures = summary["arms"][name]["figures"]
        assert float(last["energy_so_far_kwh"]) == pytest.approx(figures["energy_kwh"]["mean"])
        assert last["until"] == "09:00"
    for name in ("cumulative.png", "hourly.png"):
        assert (whole / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_same_arms_give_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    """Tables, figures' data and report do not depend on when and where they are made."""
    shutil.copytree(whole / "arms", tmp_path / "arms")
    record_wall_time(tmp_path, "B", 1, 12.34)
    write_results(tmp_path, read(tmp_path))
    made = sorted(path.name for path in whole.iterdir() if path.is_file())
    assert made == [
        *("arms.csv", "cumulative.csv", "cumulative.png", "hourly.csv", "hourly.png"),
        *("report.json", "report.md"),
    ]
    for name in made:
        assert (tmp_path / name).read_bytes() == (whole / name).read_bytes(), name


@pytest.mark.usefixtures("no_pictures")
def test_unlike_deliveries_have_no_saving_anywhere(tmp_path: Path) -> None:
    """An arm that serves fewer orders does not pass for a saving: no table, file or line has one,
    and the first lines say why.
    """
    fill(tmp_path, choose("main"))

    def poorer(arm: ArmResult) -> ArmResult:
        return replace(arm, legs=arm.legs[:15], services=arm.services[:15])

    with ArmStore(tmp_path, GROUND, "code") as store:
        for seed in SEEDS:
            store.put(POLICIES["C"], seed, poorer(make_arm(POLICIES["C"], seed)))
    evaluation = read(tmp_path)
    write_results(tmp_path, evaluation)
    text = (tmp_path / "report.md").read_text()
    why = "seeds 1, 2, 3: not the same orders: B served 24, C 15, 15 of them the same"
    head = text.split("\n## ")[0]
    assert f"C, every lever but signal priority: no saving can be told; {why}" in head
    assert "C+, every lever: saves " in head
    assert row(text, "Arms", "C")[8:] == ["–", "–", "–"]
    assert f"C, every lever but signal priority: no saving can be told; {why}" in terminal_summary(
        evaluation
    )
    summary = json.loads((tmp_path / "report.json").read_text())["arms"]["C"]
    assert set(summary["against_baseline"].values()) == {None}
    assert set(summary["no_saving"]) == {"1", "2", "3"}
    with (tmp_path / "arms.csv").open() as file:
        rows = [r for r in csv.DictReader(file) if r["arm"] == "C"]
    assert {r["saving_at_equal_time"] + r["saving_at_own_time"] for r in rows} == {""}
    assert all(r["no_saving"].startswith("not the same orders") for r in rows)


@pytest.mark.usefixtures("no_pictures")
def test_the_headline_is_at_equal_time_and_one_seed_has_no_deviation(tmp_path: Path) -> None:
    """It is the tables' figure, and tells its orders and seeds."""
    fill(tmp_path, choose("main"))
    evaluation = read(tmp_path)
    found = evaluation.headline("C")
    assert found.saving is not None
    assert found.saving == evaluation.against("C", lambda c: c.at_equal_time)
    assert (found.orders, found.seeds, found.missing) == (72, SEEDS, {})
    (line,) = [line for line in headlines(evaluation) if line.startswith("C, ")]
    assert line.endswith("for each order at equal travel time against B (72 orders, 3 seeds)")
    assert f"{100 * found.saving.mean:.1f} ± " in line
    with ArmStore(tmp_path, GROUND, "code") as store:
        alone = collect(store, GROUND, (2,))
    (line,) = [line for line in headlines(alone) if line.startswith("C, ")]
    assert "±" not in line.split("(")[0]
    assert line.endswith("(24 orders, seed 2 alone, so without a ±)")


@pytest.mark.usefixtures("no_pictures")
def test_without_paces_or_arms_there_is_no_headline(tmp_path: Path) -> None:
    """B and C alone do not tell a saving from slower driving."""
    fill(tmp_path, choose("B,C"))
    (line,) = headlines(read(tmp_path))
    assert "no saving can be told; seeds 1, 2, 3: no pace of B was simulated beside it" in line
    fill(tmp_path / "other", choose("B"))
    assert headlines(read(tmp_path / "other")) == [
        "no saving can be told: none of C, C+, installed is there"
    ]


def test_without_matplotlib_all_the_rest_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line says so, in the report too."""
    fill(tmp_path, choose("B"))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    missing = write_results(tmp_path, read(tmp_path))
    assert missing is not None
    assert "slipstream-lab" in missing
    assert missing in (tmp_path / "report.md").read_text()
    assert (tmp_path / "hourly.csv").stat().st_size > 0
    assert not (tmp_path / "hourly.png").exists()


@pytest.mark.usefixtures("no_pictures")
def test_arms_of_different_code_are_not_mixed_silently(tmp_path: Path) -> None:
    """The report says so, as it does of seeds that an arm has not."""
    fill(tmp_path, choose("B"), code="old")
    fill(tmp_path, choose("C")[1:], code="new")
    (tmp_path / "arms" / "C-2.json").unlink()
    evaluation = read(tmp_path)
    write_results(tmp_path, evaluation)
    text = (tmp_path / "report.md").read_text()
    assert "different code" in text
    assert "C has no seed 2" in text
    assert "different code" in terminal_summary(evaluation)
