"""`slipstream solve --model`."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from slipstream_cli.main import main

MILP = "min\n obj: x + 2 y\nst\n c: x + y >= 1\ngeneral\n x y\nend\n"


@pytest.fixture
def qubo(tmp_path: Path) -> tuple[Path, float]:
    """A QUBO of six variables with weights up to a million, and its least value."""
    rng = np.random.default_rng(4)
    upper = np.triu(rng.integers(-(10**6), 10**6, size=(6, 6)))
    path = tmp_path / "a.coo"
    entries = [f"{i} {j} {upper[i, j]}" for i in range(6) for j in range(i, 6)]
    path.write_text("\n".join(["# vartype=BINARY offset=-7", *entries]) + "\n")
    least = min(float(x @ upper @ x) for x in map(np.array, product((0, 1), repeat=6)))
    return path, least - 7


@pytest.mark.process
@pytest.mark.slow
def test_all_solvers_answer_in_the_models_units(
    qubo: tuple[Path, float], capsys: pytest.CaptureFixture[str]
) -> None:
    """The least of all states, by each; circuits beside what needs no circuit."""
    path, least = qubo
    names = ["exact", "tabu", "annealing", "lc-qaoa", "qaoa"]
    assert main(["solve", "--model", str(path), "--solver", *names, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["solvers"]
    assert [row["solver"] for row in rows] == names
    assert [row["objective"] for row in rows] == pytest.approx([least] * 5)
    assert rows[0]["status"] == "optimal"
    for row in rows[3:]:
        assert row["optimal_cost"] == pytest.approx(least, rel=1e-9)
        assert row["optimum_proven"]
        assert "uniform bits" in row["controls"]
    assert "marginals" in rows[3]["controls"]


def test_a_milp_is_solved_by_highs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And its values are told."""
    path = tmp_path / "a.lp"
    path.write_text(MILP)
    assert main(["solve", "--model", str(path)]) == 0
    out = capsys.readouterr().out
    assert "exact: optimal, objective 1, bound 1" in out
    assert "  x = 1" in out


def test_why_a_model_is_infeasible_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a line of its own, and as `warnings` in JSON."""
    path = tmp_path / "a.lp"
    path.write_text("min\n obj: x\nst\n c: x + y >= -5\nbounds\n x <= -1\nend\n")
    assert main(["solve", "--model", str(path)]) == 1
    told = capsys.readouterr().out.splitlines()
    assert told[1] == "warning: x has inconsistent bounds: from 0 to -1"
    assert told[2].startswith("exact: infeasible, no answer")
    assert main(["solve", "--model", str(path), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["warnings"] == ["x has inconsistent bounds: from 0 to -1"]
    assert document["sense"] == "minimise"


def test_spins_or_bits_are_never_guessed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Coordinates that do not say it are refused with the option that does."""
    path = tmp_path / "a.coo"
    path.write_text("0 0 0.5\n0 1 1\n")
    assert main(["solve", "--model", str(path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "a.coo: does not say whether its variables are bits or spins; give --vartype" in line
    assert main(["solve", "--model", str(path), "--vartype", "spin", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["solvers"][0]["objective"] == -1.5
    assert main(["solve", "--instance", "arc06-valley", "--vartype", "SPIN"]) == 2
    assert "--vartype: only for --model" in capsys.readouterr().err


def test_a_published_name_without_an_ending_has_its_format_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The Biq Mac library's graphs end in a number."""
    path = tmp_path / "g05_3.0"
    path.write_text("3 3\n1 2 1\n1 3 1\n2 3 1\n")
    assert main(["solve", "--model", str(path)]) == 2
    assert "or give --format" in capsys.readouterr().err
    assert main(["solve", "--model", str(path), "--format", "MC", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["sense"], document["solvers"][0]["objective"]) == ("maximise", 2.0)
    assert main(["solve", "--model", str(path), "--format", "xls"]) == 2
    assert "--format: no format 'xls'; take one of lp, mps" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--solver", "tabu"], "tabu solves QUBOs"),
        (["--instance", "arc06-valley"], "not for --model"),
        (["--form", "arc"], "not for --model"),
        (["--gamma", "3"], "not for --model"),
    ],
    ids=["constraints", "instance", "form", "gamma"],
)
def test_what_does_not_fit_is_refused(
    arguments: list[str], problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit status 2."""
    path = tmp_path / "a.lp"
    path.write_text(MILP)
    assert main(["solve", "--model", str(path), *arguments]) == 2
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--solver", "insertion"], "insertion takes no model"),
        (["--solver", "lc-qaoa", "--variant", "one-hot"], "needs route options"),
        (["--solver", "lc-qaoa", "--backend", "aer:FakeNowhere"], "FakeNowhere"),
    ],
    ids=["insertion", "one-hot", "backend"],
)
def test_solvers_that_need_routes_are_refused(
    arguments: list[str],
    problem: str,
    qubo: tuple[Path, float],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Before anything takes time."""
    assert main(["solve", "--model", str(qubo[0]), *arguments]) == 2
    assert problem in capsys.readouterr().err
