"""The world benchmark: what it judges, and what it finds the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.simulation.evaluation.fakes import make_arm
from slipstream_lab.benchmarks.aims import Check
from slipstream_lab.benchmarks.world import __main__ as command
from slipstream_lab.benchmarks.world import bench
from slipstream_lab.benchmarks.world.bench import (
    WorldBenchSettings,
    compare_folders,
    read_saved,
    run_bench,
)
from slipstream_lab.benchmarks.world.figures import (
    Repeat,
    Saved,
    TimedRun,
    repeat_checks,
    saving_checks,
    time_checks,
)
from slipstream_lab.benchmarks.world.report import WorldResults, checks, markdown
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.runs.store import ArmStore
from slipstream_lab.simulation.evaluation.runs.world import World, WorldFiles

DAY = TimedRun("background", "troy", 1, 24.0, 100.0, 90.0, 400.0)
ARM = TimedRun("C+", "troy", 1, 24.0, 500.0, 480.0, 400.0)
SAVED = Saved("troy", 24.0, (1, 2, 3), 0.20, 0.12, 0.11, 0.002, 0.025)


def verdicts(found: list[Check]) -> list[bool | None]:
    """Whether each is reached."""
    return [check.reached for check in found]


def test_the_worst_whole_day_is_judged_and_parts_of_a_day_are_not() -> None:
    """120 s for a background, 600 s for an arm, alone or beside another."""
    assert verdicts(time_checks([DAY, ARM, replace(ARM, beside=1)])) == [True, True, True]
    assert verdicts(time_checks([DAY, replace(DAY, seed=2, wall_s=121.0)])) == [False]
    assert verdicts(time_checks([ARM, replace(ARM, beside=1, wall_s=601.0)])) == [True, False]
    assert verdicts(time_checks([replace(ARM, hours=1.0)])) == [None]
    assert verdicts(time_checks([replace(DAY, faults=("2 teleports",))])) == [True, False]


def test_savings_are_judged_by_their_aims() -> None:
    """18.5 % with every lever, 10 % without priority, a tenth of it lost to noise at most; in the
    corridor four fifths of what drafting can save."""
    assert verdicts(saving_checks([SAVED])) == [True, True, True]
    low = replace(SAVED, every=0.18, without_priority=0.09, noisy=0.08)
    assert verdicts(saving_checks([low])) == [False, False, False]
    assert verdicts(saving_checks([replace(SAVED, hours=2.0)])) == [None, None, None]
    corridor = replace(SAVED, scenario="corridor", drag=0.11, drafting_ceiling=0.13, noisy=None)
    assert verdicts(saving_checks([corridor])) == [True, None, None]
    assert verdicts(saving_checks([replace(corridor, drag=0.1)])) == [False, None, None]
    assert verdicts(saving_checks([replace(SAVED, refused=("C of seed 1",))]))[-1] is False
    assert SAVED.lost_by_noise == pytest.approx(1 / 12)
    assert replace(SAVED, without_priority=-0.01).lost_by_noise is None
    assert replace(corridor, drag=None).of_drafting is None


def test_results_that_differ_by_a_byte_are_named(tmp_path: Path) -> None:
    """Every file but those that tell how long it took; one that is missing differs too."""
    folders = tmp_path / "1", tmp_path / "2"
    for folder in folders:
        (folder / "arms").mkdir(parents=True)
        (folder / "arms" / "B-1.json").write_text("same")
        (folder / "run.json").write_text(folder.name)
    assert compare_folders(*folders) == (1, ())
    (folders[0] / "report.md").write_text("a")
    (folders[1] / "report.md").write_text("b")
    (folders[1] / "more.csv").write_text("")
    assert compare_folders(*folders) == (3, ("more.csv", "report.md"))
    assert verdicts(repeat_checks([Repeat("troy", 1.0, "B", 3, ("report.md",))])) == [False]
    assert verdicts(repeat_checks([Repeat("troy", 1.0, "B", 0, ())])) == [False]


def test_a_run_that_fails_is_told_and_the_rest_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What could not be measured stands in the report with the reason."""

    def failing(command: object, log: object, limit_s: float) -> object:
        raise RuntimeError("it ended with status 3")

    monkeypatch.setattr(bench, "watched", failing)
    said: list[str] = []
    settings = WorldBenchSettings(out=tmp_path / "out", seeds=(5,), parts=("background",))
    results = run_bench(settings, said.append)
    assert len(results.missing) == len(said) == 2
    assert "it ended with status 3" in (tmp_path / "out" / "report.md").read_text()
    assert checks(results) == []


def test_the_report_shows_times_and_folders() -> None:
    """One row a run, and where the tables are."""
    text = markdown(WorldResults(runs=(DAY, ARM), saved=(SAVED,), tables=("out/troy-0-24",)), {})
    assert "| troy | 1 | background | 24 | 100.0 | 90.0 | 400 | 0 |" in text
    assert "out/troy-0-24/report.md" in text
    assert "20.00 %" in text


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["--only", "nothing"], "--only"),
        (["--seeds", "one"], "--seeds"),
        (["--scenarios", "paris"], "--scenarios"),
    ],
)
def test_slips_are_told_in_one_line(
    arguments: list[str], key: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2, naming the option."""
    assert command.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert key in error


def test_savings_are_read_from_an_evaluations_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At equal travel time, the noisy arm's beside it, and the drafting ceiling from the legs of
    the baseline."""
    world = World(WorldFiles("troy"), tmp_path, "actuated", (7 * 3600.0, 8 * 3600.0))
    path = min(world.scenario.network.crossings)
    with ArmStore(tmp_path, world.provenance, "code") as store:
        for name in ("B", "B-0.88", "C", "C+", "C-noise-20"):
            arm = make_arm(POLICIES[name], 1)
            legs = tuple(replace(leg, path=path) for leg in arm.legs)
            store.put(POLICIES[name], 1, replace(arm, legs=legs))
    found = read_saved("troy", tmp_path, (7.0, 8.0), (1,))
    assert (found.scenario, found.hours, found.seeds, found.refused) == ("troy", 1.0, (1,), ())
    assert found.every is not None
    assert found.without_priority is not None
    assert found.every > found.without_priority > 0
    assert found.lost_by_noise is not None
    assert 0 < found.lost_by_noise < 1
    legs = make_arm(POLICIES["B"], 1).legs
    drag = sum(leg.alone.drag_kwh for leg in legs) / sum(leg.alone.total_kwh for leg in legs)
    assert found.drafting_ceiling == pytest.approx(0.2 * drag)
    assert found.of_drafting is not None
    assert 0 < found.of_drafting < 1
