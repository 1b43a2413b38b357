"""`slipstream bench qoblib` as a user meets it."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from lab.tests.research.qoblib.instances import NAME, OPTIMUM, instance_text, library
from slipstream_cli.main import main
from slipstream_lab.research.qoblib import bench as referee
from slipstream_lab.research.qoblib.report import COLUMNS
from slipstream_lab.research.qoblib.solvers import SOLVERS

Capture = pytest.CaptureFixture[str]

TINY = ("--seeds", "1", "--iterations", "3", "--shots", "64")


def command(data: Path, out: Path, *more: str) -> list[str]:
    """Of a tiny run."""
    return [
        *("bench", "qoblib", "--class", "routing", "--data", str(data), "--out", str(out)),
        *TINY,
        *more,
    ]


def read(path: Path) -> list[dict[str, str]]:
    """A table's rows, of which the columns are the library's."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.DictReader(file)
        assert tuple(rows.fieldnames or ()) == COLUMNS
        return list(rows)


@pytest.mark.nightly
@pytest.mark.process
def test_a_small_library_is_run_stored_and_not_run_again(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every solver beside the others, in the library's form; then all comes from the store."""
    library(tmp_path)
    out = tmp_path / "out"
    assert main(command(tmp_path, out, "--submitter", "Ours", "--json")) == 0
    captured = capsys.readouterr()
    assert captured.err == ""  # a pipe sees no progress
    document: dict[str, Any] = json.loads(captured.out)
    lines = {line["solver"]: line for line in document["lines"]}
    assert tuple(lines) == SOLVERS
    for line in lines.values():
        assert (line["runs"], line["optimal"], line["best"], line["gap"]) == (1, 1, OPTIMUM, 0)
        assert line["cpu_s"] > 0
        assert line["reason"] is None
    assert document["instances"][0]["routes"] == 9
    table = {row["Workflow"]: row for row in read(out / "summary.csv")}
    assert len(table) == len(SOLVERS)
    of_circuit = out / "submission" / "circuit" / NAME
    (row,) = read(of_circuit / f"{NAME}_summary.csv")
    assert row == table[row["Workflow"]]
    numbers = ("Best Objective Value", "# Binary Variables", "# Runs", "# Feasible Runs")
    assert [row[name] for name in numbers] == [str(OPTIMUM), "9", "1", "1"]
    assert (row["Problem"], row["Submitter"], row["QPU Runtime"]) == (NAME, "Ours", "N/A")
    *routes, cost = (of_circuit / f"{NAME}_solution.sol").read_text().splitlines()
    served = [int(n) for route in routes for n in route.split(":")[1].split()]
    assert (sorted(served), cost) == (list(range(1, 13)), f"Cost {OPTIMUM}")

    def refuse(task: object) -> None:
        raise AssertionError(f"{task} is run again")

    monkeypatch.setattr(referee, "run_task", refuse)
    monkeypatch.setattr(referee, "WorkerExecutor", refuse)
    assert main(command(tmp_path, out)) == 0
    text = capsys.readouterr().out
    assert f"| {NAME} | no-gates | 1 | 1 | 1 | {OPTIMUM} | 0.00% |" in text
    assert (out / "report.md").read_text() == text


@pytest.mark.nightly
@pytest.mark.process
def test_a_run_that_is_too_long_is_ended_and_the_others_go_on(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A solver that does not look at the clock: its worker is killed, the reason is told."""
    library(tmp_path, solution=False)
    monkeypatch.setattr(referee, "SOLVERS", ("circuit", "marginals", "exact"))
    # Training alone looks at no clock within an evaluation of ten layers.
    slow = ("--layers", "10", "--limit", "1")
    assert main(command(tmp_path, tmp_path / "out", "--json", *slow)) == 0
    document = json.loads(capsys.readouterr().out)
    lines = {line["solver"]: line for line in document["lines"]}
    assert lines["circuit"]["reason"] == "no answer within 1 s; ended"
    assert lines["marginals"]["reason"] == "the circuit has no time to compare with"
    assert lines["exact"]["best"] == OPTIMUM


def test_nothing_stored_is_no_answer(capsys: Capture, tmp_path: Path) -> None:
    """Exit status 1, and no run."""
    library(tmp_path)
    assert main(command(tmp_path, tmp_path / "out", "--stored", "--json")) == 1
    assert json.loads(capsys.readouterr().out)["lines"] == []


def test_ctrl_c_says_how_to_go_on(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line and exit status 130."""
    library(tmp_path)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(referee, "WorkerExecutor", interrupt)
    assert main(command(tmp_path, tmp_path / "out")) == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "the same command goes on" in captured.err


@pytest.mark.parametrize(
    ("text", "more", "said"),
    [
        (None, (), "--data: no routing instance"),
        ("NAME : x", (), "x-k1.vrp"),
        (instance_text("x-k4"), (), "does not need exactly 4 vehicles"),
        (instance_text("x-k3"), ("--seeds", "0"), "seeds"),
        (instance_text("x-k3"), ("--circuit", "product"), "circuit"),
    ],
    ids=["none", "malformed", "idle", "seeds", "circuit"],
)
def test_bad_input_is_one_line(
    capsys: Capture, tmp_path: Path, text: str | None, more: tuple[str, ...], said: str
) -> None:
    """Exit status 2; nothing is run or written."""
    if text is not None:
        (tmp_path / "x-k1.vrp").write_text(text, encoding="utf-8")
    assert main(command(tmp_path, tmp_path / "out", *more)) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
