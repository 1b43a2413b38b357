from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipstream_cli.main import main

Capture = pytest.CaptureFixture[str]


@pytest.mark.long
def test_the_table_and_its_plot(tmp_path: Path, capsys: Capture) -> None:
    """A row for each size that can be, the paper's benchmark beside ours, and a picture."""
    picture = tmp_path / "r.png"
    sizes = ["--customers", "3", "5", "--vehicles", "2", "4"]
    assert main(["resources", *sizes, "--json", "--plot", str(picture)]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = document["rows"]
    assert [(row["customers"], row["vehicles"]) for row in rows] == [(3, 2), (5, 2), (5, 4)]
    assert rows[1]["full"]["order_bits"] == rows[1]["paper"]["qubo_order_bits"] == 30
    benchmark = document["benchmark"]
    assert benchmark["paper"]["variables"] == benchmark["reduced"]["variables"] == 25
    assert benchmark["full"]["variables"] == 56
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_table_for_people(capsys: Capture) -> None:
    """A head and a line a size."""
    assert main(["resources", "--customers", "4", "--vehicles", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any("paper, printed" in line and "128" in line for line in lines)
    assert lines[-1].split()[:3] == ["4", "2", "40"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--customers", "0"), "--customers: out of range"),
        (("--vehicles", "21"), "--vehicles: out of range"),
        (("--customers", "3", "--vehicles", "4"), "more vehicles than customers"),
        (("--seed", "-1"), "--seed: out of range"),
        (("--plot", "picture.txt"), "no picture's suffix"),
        (("--plot", "/nowhere/r.png"), "/nowhere/r.png: --plot: no such folder"),
    ],
)
def test_bad_input_is_one_line(arguments: tuple[str, ...], said: str, capsys: Capture) -> None:
    """Exit status 2 before anything is counted."""
    assert main(["resources", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
