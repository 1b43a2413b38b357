"""`slipstream export instance`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slipstream_cli.main import main


def test_a_package_and_single_models(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every file that is named is there; nothing but JSON is printed."""
    for kind, count in (("qoblib", 6), ("lp", 1), ("mps", 1), ("qs", 1)):
        out = tmp_path / kind
        command = ["export", "instance", "arc06-valley", "--out", str(out), "--json"]
        assert main([*command, "--format", kind]) == 0
        files = json.loads(capsys.readouterr().out)["files"]
        assert sorted(files) == sorted(str(p) for p in out.rglob("*") if p.is_file())
        assert len(files) == count


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["instance", "--out", "OUT"], "no instance"),
        (["instance", "nowhere", "--out", "OUT"], "no instance of this name"),
        (["instance", "arc06-valley", "--out", "OUT", "--format", "csv"], "csv is for tables"),
        (["instance", "arc06-valley", "--out", "OUT", "--from", "2026-01-01"], "only for tables"),
        (["instance", "arc06-valley", "--out", "FULL"], "is not empty"),
        (["cycles", "arc06-valley", "--out", "OUT"], "after a table"),
        (["cycles", "--out", "OUT", "--format", "lp"], "lp is for instances"),
    ],
    ids=["none", "unknown", "format", "time", "full", "table", "table-format"],
)
def test_mistakes(
    arguments: list[str], problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line and exit status 2; nothing is written."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").touch()
    paths = {"OUT": str(tmp_path / "out"), "FULL": str(tmp_path / "full")}
    assert main(["export", *(paths.get(word, word) for word in arguments)]) == 2
    assert problem in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
