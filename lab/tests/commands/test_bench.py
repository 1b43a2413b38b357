"""`slipstream bench quantum` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from dispatcher_daemon.solvers.quantum.backends import ServiceFault, open_backend
from slipstream_cli.main import main
from slipstream_lab.research.quantum import run as bench_run
from slipstream_lab.research.quantum.backends import opening

Capture = pytest.CaptureFixture[str]

TINY = (
    *("--only", "sweep", "--layers", "1", "--instances", "1", "--noise", "aer"),
    *("--shots", "64", "--iterations", "2"),
)


def bench(capsys: Capture, out: Path, *arguments: str) -> dict[str, Any]:
    """The JSON of a tiny run."""
    assert main(["bench", "quantum", *TINY, "--out", str(out), "--json", *arguments]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""  # a pipe sees no progress
    document: dict[str, Any] = json.loads(captured.out)
    return document


def test_a_tiny_sweep_is_measured_stored_and_not_measured_again(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows beside the paper's figures, marked; a second run takes all from the store."""
    document = bench(capsys, tmp_path)
    rows = document["tables"]["sweep"]
    literal = next(row for row in rows if "paper's method" in row["title"])
    assert literal["mark"] == "simulated"
    assert literal["paper"]["p_feasible"] == 0.125
    for row in rows:
        assert 0 <= row["figures"]["p_optimal"]["mean"] <= row["figures"]["p_feasible"]["mean"] <= 1
        assert {"uniform bits", "marginals"} <= {added["control"] for added in row["added"]}
    assert (tmp_path / "report.md").read_text().startswith("### ")
    assert json.loads((tmp_path / "report.json").read_text()) == document

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is measured again")

    monkeypatch.setattr(bench_run, "open_case", refuse)
    assert bench(capsys, tmp_path) == document
    assert bench(capsys, tmp_path, "--stored") == document
    nothing = bench(capsys, tmp_path, "--stored", "--seed", "9")["tables"]["sweep"]
    assert all((row["figures"], row["mark"]) == ({}, "not run") for row in nothing)


def test_ctrl_c_says_how_to_go_on(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, exit status 130, and the folder is free for the next run."""

    def interrupt(name: str) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(bench_run, "open_case", interrupt)
        assert main(["bench", "quantum", *TINY, "--out", str(tmp_path)]) == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "the same command goes on" in captured.err
    assert str(tmp_path) in captured.err
    bench(capsys, tmp_path, "--stored")


@pytest.mark.parametrize(
    ("name", "lines", "said"),
    [("results.jsonl", "7\n7\n", "line 1"), ("report.json/x", "", "--out")],
)
def test_damaged_and_unwritable_results_are_one_line(
    capsys: Capture, tmp_path: Path, name: str, lines: str, said: str
) -> None:
    """Neither is passed over, neither is a traceback."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(lines)
    assert main(["bench", "quantum", *TINY, "--out", str(tmp_path), "--stored"]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert said in captured.err


@pytest.mark.long
def test_a_device_that_was_replaced_is_not_called_hardware(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows of a device that is out of reach are marked by where their samples came from."""
    monkeypatch.setattr(opening, "open_backend", refusing)
    (row, _) = bench(capsys, tmp_path, "--noise", "aer:FakeBoston")["tables"]["sweep"]
    assert row["mark"] == "simulated, 1 of 1"
    assert row["reason"] == "aer:FakeBoston: no answer"


def refusing(text: str) -> Any:
    """Nothing but Aer is within reach."""
    if text != "aer":
        raise ServiceFault("unreachable", "no answer")
    return open_backend(text)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--instances", "21"), "instances"),
        (("--shots", "0"), "shots"),
        (("--layers", "0"), "layers"),
        (("--layers", "99"), "layers"),
        (("--seed", "-1"), "seed"),
        (("--noise", "nowhere"), "nowhere"),
        (("--noise", "aer:FakeNowhere"), "FakeNowhere"),
    ],
)
def test_bad_input_is_one_line(
    capsys: Capture, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    """A user's mistake is one line on standard error and exit status 2."""
    assert main(["bench", "quantum", "--out", str(tmp_path), *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("slipstream: ")
    assert captured.err.count("\n") == 1
    assert said in captured.err
