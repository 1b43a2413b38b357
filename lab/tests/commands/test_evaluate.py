"""`slipstream evaluate` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from lab.tests.research.coordination.fakes import result
from lab.tests.simulation.evaluation.fakes import make_arm
from slipstream_cli.main import main
from slipstream_lab.research.coordination import curve
from slipstream_lab.research.coordination.cells import CellResult, CoordinationCell
from slipstream_lab.simulation.closed_loop.arm import ArmSpec
from slipstream_lab.simulation.closed_loop.policy import WaitingPrices
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation import exogenous, report
from slipstream_lab.simulation.evaluation.exogenous import ExogenousSpec
from slipstream_lab.simulation.evaluation.report import files
from slipstream_lab.simulation.evaluation.runs import world
from slipstream_lab.simulation.scenarios.scenario import BackgroundTraffic, Scenario, load_scenario

Capture = pytest.CaptureFixture[str]

CEILING_TABLES = report.ceiling_tables

MORNING = ("--scenario", "corridor", "--begin", "6", "--hours", "3")


@pytest.fixture
def orders(monkeypatch: pytest.MonkeyPatch) -> list[ArmSpec]:
    """Arms are made up instead of simulated; what was ordered."""
    ordered: list[ArmSpec] = []

    def run_arm(order: ArmSpec, _: object) -> ArmResult:
        ordered.append(order)
        return make_arm(order.policy, order.seed)

    def prepare(scenario: Scenario, seed: int, folder: Path) -> BackgroundTraffic:
        return BackgroundTraffic((folder / f"{scenario.name}-{seed}.rou.xml",), scenario.rsus or ())

    monkeypatch.setattr(world, "run_arm", run_arm)
    monkeypatch.setattr(world, "prepare", prepare)
    monkeypatch.setattr(world, "history_of", lambda scenario, seed, folder, **_: folder / "history")
    monkeypatch.setattr(files, "draw", lambda evaluation, folder: ())
    # Ceilings take a second, which only their own test need wait for.
    monkeypatch.setattr(report, "ceiling_tables", lambda evaluation, roads: ())
    return ordered


def evaluate(capsys: Capture, out: Path, *arguments: str, said: str = "") -> dict[str, Any]:
    """The summary of a run in a pipe, which says nothing else."""
    assert main(["evaluate", *MORNING, "--out", str(out), "--json", *arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == said
    document: dict[str, Any] = json.loads(captured.out)
    return document


@pytest.mark.slow
def test_arms_are_simulated_once_and_reported_again(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec]
) -> None:
    """Every arm and seed is ordered as asked; a second run takes all of them from the folder and
    prints the same; further arms join them."""
    first = evaluate(capsys, tmp_path, "--arms", "A,B", "--seeds", "2,1")
    assert {(o.policy.name, o.seed) for o in orders} == {("A", 1), ("A", 2), ("B", 1), ("B", 2)}
    for order in orders:
        assert (order.scenario, order.begin_s, order.end_s) == ("corridor", 21600.0, 32400.0)
        assert order.background == (tmp_path / "background" / f"corridor-{order.seed}.rou.xml",)
        assert order.additional == ()
    assert list(first["arms"]) == ["A", "B"]
    assert first["arms"]["A"]["seeds"] == [1, 2]
    report = (tmp_path / "report.md").read_bytes()
    assert evaluate(capsys, tmp_path, "--arms", "A,B", "--seeds", "1,2") == first
    assert evaluate(capsys, tmp_path, "--stored", "--seeds", "1,2") == first
    assert (len(orders), (tmp_path / "report.md").read_bytes()) == (4, report)
    more = evaluate(capsys, tmp_path, "--arms", "C", "--seeds", "1,2")
    assert list(more["arms"]) == ["A", "B", "C"]
    assert len(orders) == 6
    assert main(["evaluate", *MORNING, "--out", str(tmp_path), "--arms", "C", "--seeds", "1"]) == 0
    terminal_summary = capsys.readouterr().out
    assert "2 of 2 arms were stored already" in terminal_summary
    assert str(tmp_path / "report.md") in terminal_summary


@pytest.mark.slow
def test_a_fleet_of_vans_is_another_evaluation(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec]
) -> None:
    """Arms have the type that is asked for, and the report says it; a folder has one; the paper's
    own way has its car."""
    evaluate(capsys, tmp_path, "--arms", "B", "--seeds", "1", "--type", "van")
    assert [order.type for order in orders] == ["van"]
    assert " of type van, RSUs " in (tmp_path / "report.md").read_text()
    again = ["evaluate", *MORNING, "--out", str(tmp_path), "--seeds", "1"]
    assert main([*again, "--arms", "B"]) == 2
    assert "type was van, is none" in capsys.readouterr().err.lower()
    assert main([*again, "--arms", "main", "--type", "van"]) == 2
    assert "exogenous arms have the paper's car" in capsys.readouterr().err


@pytest.mark.slow
def test_ceilings_and_the_papers_way_join_the_report(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked for once, they are simulated once; stored, they are in every later report."""
    monkeypatch.setattr(report, "ceiling_tables", CEILING_TABLES)
    driven: list[str] = []

    def run_in_subprocess(_: object, order: ExogenousSpec, *__: object) -> ArmResult:
        driven.append(order.policy.name)
        return make_arm(order.policy, order.seed)

    monkeypatch.setattr(exogenous, "run_in_subprocess", run_in_subprocess)
    monkeypatch.setattr(exogenous, "_recorded", lambda order: None)
    first = evaluate(capsys, tmp_path, "--arms", "C,exogenous", "--seeds", "1")
    assert set(driven) >= {"B", "C"}
    assert (
        first["exogenous"]["everywhere"]["arms"]["C"]["against_baseline"]["saving_at_own_time"][
            "mean"
        ]
        > 0
    )
    text = (tmp_path / "report.md").read_text()
    titles = [table["title"] for table in first["tables"]]
    assert any(title.startswith("Ceilings") for title in titles)
    assert any(title.startswith("The paper's way") for title in titles)
    assert all(f"## {title}" in text for title in titles)
    assert (tmp_path / "exogenous-rsus" / "arms.csv").is_file()
    count = len(driven)
    assert evaluate(capsys, tmp_path, "--arms", "C", "--seeds", "1") == first
    assert len(driven) == count


@pytest.mark.slow
def test_hours_without_a_begin_are_the_busiest_and_are_told(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec]
) -> None:
    """Midnight has no orders; a day, a given begin and a configuration's are taken as they are."""
    command = ["evaluate", "--out", str(tmp_path / "hour"), "--arms", "B", "--seeds", "1"]
    assert main([*command, "--hours", "1"]) == 0
    assert (orders[0].begin_s, orders[0].end_s) == (36_000.0, 39_600.0)
    said = "slipstream: no --begin: it begins at 10:00, where most orders come within 1 h\n"
    assert capsys.readouterr().err == said
    fleet = tmp_path / "fleet.toml"
    fleet.write_text("hours = [0,0,0,0,0,1,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0]\nwave_s = 600\n")
    command[2] = str(tmp_path / "early")
    assert main([*command, "--hours", "0.5", "--fleet", str(fleet)]) == 0
    assert (orders[1].begin_s, orders[1].end_s) == (18_000.0, 19_800.0)
    command[2] = str(tmp_path / "day")
    capsys.readouterr()
    assert main([*command, "--hours", "24"]) == 0
    assert (orders[2].begin_s, orders[2].end_s) == (0.0, 86_400.0)
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_arms_keep_databases_where_they_are_wanted(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec]
) -> None:
    """One each, beside the results; a cluster's workers have no disk for them."""
    out = tmp_path / "day"
    evaluate(capsys, out, "--arms", "B,C", "--seeds", "4", "--databases")
    kept = {order.database for order in orders}
    assert kept == {out / "databases" / "B-4.db", out / "databases" / "C-4.db"}
    cluster = tmp_path / "scheduler.toml"
    command = ["evaluate", "--out", str(tmp_path / "other"), "--arms", "B", "--seeds", "1"]
    assert main([*command, "--databases", "--cluster", str(cluster)]) == 2
    assert "--databases: arms on a cluster keep no database" in capsys.readouterr().err


def test_fixed_signals_and_files_of_ones_own_reach_the_arm(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec]
) -> None:
    """The signals' program and the fleet's file are in the order; depots, which the file does not
    name, are told there, in the report and in the summary.
    """
    fleet = tmp_path / "fleet.toml"
    fleet.write_text("vehicles = 3\n")
    options = ("--arms", "B", "--seeds", "1", "--signals", "fixed", "--fleet", str(fleet))
    depots = "depots, seed 1: w6d, east"
    line = f"slipstream: made up: {depots}\n"
    summary = evaluate(capsys, tmp_path / "out", *options, said=line)
    assert summary["made_up"] == [depots]
    assert f"- made up: {depots}\n" in (tmp_path / "out" / "report.md").read_text()
    (order,) = orders
    assert [path.name for path in order.additional] == ["corridor-fixed.add.xml"]
    assert order.additional[0].is_file()
    assert order.fleet == fleet
    fleet.write_text("vehicles = 4\n")
    command = ["evaluate", *MORNING, *options, "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert "arms of another evaluation (fleet was" in capsys.readouterr().err


def test_prices_of_waiting_reach_the_arm_and_are_of_a_folder_of_their_own(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec]
) -> None:
    """They are in the order, in the report and in the summary; what is stored is of one price."""
    options = ("--arms", "B", "--seeds", "1")
    evaluate(capsys, tmp_path / "priced", *options, "--waiting-kw", "0", "--standing-kw", "2.5")
    summary = evaluate(capsys, tmp_path / "as-driving", *options)
    assert [order.prices for order in orders] == [WaitingPrices(0.0, 2.5), WaitingPrices()]
    assert (summary["ground"]["waiting_kw"], summary["ground"]["standing_kw"]) == (None, None)
    said = "an hour of waiting for other vehicles costs 0 kW at depots, 2.5 kW at stops"
    assert said in (tmp_path / "priced" / "report.md").read_text()
    said = "an hour of waiting for other vehicles costs what slower driving would save"
    assert said in (tmp_path / "as-driving" / "report.md").read_text()
    command = ["evaluate", *MORNING, *options, "--out", str(tmp_path / "priced")]
    assert main(command) == 2
    assert "of another evaluation (waiting_kw was 0.0, is None; s" in capsys.readouterr().err
    assert len(orders) == 2


@pytest.mark.nightly
def test_each_driven_density_is_an_evaluation_of_a_scaled_fleet(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Orders and vehicles in proportion, all else as it was; finished ones are kept; one table and
    one picture with what is planned only, which is planned for the seeds that are driven."""
    planned: list[CoordinationCell] = []

    def measured(cell: CoordinationCell, *_: object) -> CellResult:
        planned.append(cell)
        return result(2.0, 1.0, 3.0, cell=cell)

    monkeypatch.setattr(curve, "measured", measured)
    monkeypatch.setattr(
        curve, "found", lambda cell, _: result(2.0, 1.0, 3.0, cell=cell) if planned else None
    )
    words = ("--density", "20,5", "--drive", "100,29", "--arms", "C", "--seeds", "1")
    words = (*words, "--workers", "1")
    first = evaluate(capsys, tmp_path, *words)
    assert [(c.vehicles, c.seed) for c in planned] == [(5, 1)] * 4 + [(20, 1)] * 4
    assert [row["vehicles"] for row in first["planned"]] == [5, 20] * 4
    assert list(first["driven"]) == ["29", "100"]
    assert [order.policy.name for order in orders] == ["B", "C"] * 2
    fleets = {order.fleet: load_scenario("corridor", fleet=order.fleet).fleet for order in orders}
    assert [path.parent.name for path in fleets if path] == ["density-29", "density-100"]
    assert [(f.orders, f.vehicles) for f in fleets.values()] == [(66, 18), (228, 62)]
    own = load_scenario("corridor").fleet
    assert all(
        f.model_copy(update={"orders": own.orders, "vehicles": own.vehicles}) == own
        for f in fleets.values()
    )
    assert evaluate(capsys, tmp_path, *words) == first
    assert (len(orders), len(planned)) == (4, 8)
    text = (tmp_path / "density.md").read_text()
    assert "| one carrier | 20 |" in text
    assert "| 29 |" in text
    assert "| 100 |" in text
    assert (tmp_path / "density.png").stat().st_size > 1000
    assert (tmp_path / "density-100" / "report.md").is_file()


@pytest.mark.nightly
def test_a_curve_that_is_interrupted_goes_on_to_the_same(capsys: Capture, tmp_path: Path) -> None:
    """Really planned: two densities of a few vehicles, gone on with after half of the files are
    lost, in two processes and in one; then everything is stored."""
    words = ["evaluate", "--scenario", "corridor", "--density", "2,3", "--seeds", "1"]
    whole, half = tmp_path / "whole", tmp_path / "half"
    assert main([*words, "--out", str(whole), "--workers", "2"]) == 0
    assert capsys.readouterr().out == f"{whole / 'density.md'}\n"
    stored = sorted((whole / "planned").iterdir())
    # Nobody can wait for ten minutes at 27 kW, so a shorter window is planned in its place.
    assert [path.name for path in stored if path.name.startswith("one-2-")] == [
        "one-2-10min-0kw-seed1.json",
        "one-2-5min-27kw-seed1.json",
    ]
    (half / "planned").mkdir(parents=True)
    kept = {path.name: path.read_bytes() for path in stored[::2]}
    for name, content in kept.items():
        (half / "planned" / name).write_bytes(content)
    assert main([*words, "--out", str(half), "--workers", "1"]) == 0
    for name in ("density.md", "density.png"):
        assert (half / name).read_bytes() == (whole / name).read_bytes()
    assert all((half / "planned" / name).read_bytes() == kept[name] for name in kept)
    capsys.readouterr()
    assert main([*words, "--out", str(half), "--stored", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [row["vehicles"] for row in document["planned"]] == [2, 3] * 4
    assert document["driven"] == {}
    assert len(list((half / "planned").iterdir())) == len(stored)


def test_a_gridlock_is_one_line_after_all_is_written(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm, the seed, the time and the mend; the report has what stood."""
    monkeypatch.setattr(
        world,
        "run_arm",
        lambda order, _: make_arm(order.policy, order.seed, gridlock_s=30000.0),
    )
    assert main(["evaluate", *MORNING, "--out", str(tmp_path), "--arms", "B", "--seeds", "4"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "corridor, arm B, seed 4: gridlock at 08:20; take fewer trips" in error
    assert "B, seed 4, is refused: gridlock at 08:20" in (tmp_path / "report.md").read_text()


def test_ctrl_c_says_how_to_go_on(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, exit status 130; what was finished is there for the next run."""

    def interrupt(order: ArmSpec, _: object) -> ArmResult:
        if order.policy.name == "B":
            raise KeyboardInterrupt
        return make_arm(order.policy, order.seed)

    command = [
        *("evaluate", *MORNING, "--out", str(tmp_path)),
        *("--arms", "A,B", "--seeds", "1", "--workers", "1"),
    ]
    with monkeypatch.context() as patch:
        patch.setattr(world, "run_arm", interrupt)
        assert main(command) == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "the same command goes on" in captured.err
    assert main(command) == 0
    assert [order.policy.name for order in orders] == ["B"]


def test_without_libsumo_the_line_says_what_to_install(
    capsys: Capture, tmp_path: Path, orders: list[ArmSpec], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The extra is named."""

    def missing(order: ArmSpec, _: object) -> ArmResult:
        raise ModuleNotFoundError("No module named 'libsumo'", name="libsumo")

    monkeypatch.setattr(world, "run_arm", missing)
    assert main(["evaluate", *MORNING, "--out", str(tmp_path), "--arms", "B"]) == 2
    assert "libsumo is not installed; pip install 'slipstream-lab'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--arms", "D"), "--arms: no arm 'D'"),
        (("--scenario", "utopia"), "utopia: no such scenario"),
        (("--scenario", "own", "--net", "missing.net.xml"), "missing.net.xml"),
        (("--rsus", "missing.toml"), "missing.toml: no such file"),
        (("--routes", "missing.rou.xml"), "missing.rou.xml: no such file"),
        (("--seeds", "1,x"), "--seeds"),
        (("--hours", "0"), "--hours"),
        (("--begin", "20", "--hours", "5"), "are no part of a day"),
        (("--begin", "7.01"), "no multiple of five minutes"),
        (("--workers", "0"), "--workers"),
        (("--density", "29,x"), "--density: no whole numbers from 1 on: '29,x'; give some as 20"),
        (("--density", "900000"), "--density: 900000 vehicles a day are too many"),
        (("--density", "29", "--fleet", "f.toml"), "f.toml: no such file"),
        (("--density", "29", "--arms", "B,C"), "--drive: arms, hours and prices are of"),
        (("--waiting-kw", "-1", "--arms", "B"), "--waiting-kw: no price: -1; give 0 or more"),
        (("--standing-kw", "nan", "--arms", "B"), "--standing-kw: no price: nan"),
        (("--waiting-kw", "0"), "--waiting-kw: waiting has no price in exogenous arms; give"),
        (("--density", "29", "--drive", "x"), "--drive: no whole numbers from 1 on"),
        (("--density", "29", "--drive", "900000"), "900000 vehicles a day are too many"),
        (("--density", "29", "--drive", "29", "--arms", "main"), "--arms: no density has"),
        (("--density", "29", "--stored"), "nothing of these is stored; run it without --stored"),
        (("--stored",), "no arm of these seeds is stored"),
    ],
)
def test_bad_input_is_one_line(
    capsys: Capture, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    """It names the option or the file, the fault and the mend."""
    command = ["evaluate", "--out", str(tmp_path / "out"), "--scenario", "corridor", *arguments]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error


def test_a_folder_that_cannot_be_written_is_one_line(capsys: Capture, tmp_path: Path) -> None:
    """The option that gave it is named."""
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file")
    assert main(["evaluate", "--scenario", "corridor", "--out", out, "--arms", "B"]) == 2
    assert "--out" in capsys.readouterr().err
