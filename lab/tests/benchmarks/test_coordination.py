"""The coordination benchmark: a cell, its aims, and the short form, gone on with."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.research.coordination.fakes import result
from slipstream_lab.benchmarks.coordination.__main__ import main
from slipstream_lab.benchmarks.coordination.report import checks, markdown


def test_aims() -> None:
    """Share of the bound, rivals that are fair, carriers."""
    assert all(check.reached for check in checks([result(9.0, 9.0, 10.0)]))
    missed = [result(8.9, 0.0, 10.0), result(9.0, 9.1, 10.0), result(9.0, 0.0, 9.0, -0.1)]
    for number, bad in enumerate(missed):
        assert [check.reached for check in checks([bad])].index(False) == number
    unfair = result(9.0, 9.1, 10.0)
    rows = tuple(
        replace(r, outcome=replace(r.outcome, carrier_kwh=(-1.0, 1.0)))
        if r.strategy == "hub waiting"
        else r
        for r in unfair.plans.rows
    )
    unfair = replace(unfair, plans=replace(unfair.plans, rows=rows))
    assert all(check.reached for check in checks([unfair]))
    assert "91.0%\\*" in markdown([unfair], {})


def test_bad_options_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit status 2."""
    for words in (["--vehicles", "x"], ["--windows", "0"], ["--prices", "-1"], ["--trucks", "-1"]):
        assert main(words) == 2
        assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.long
def test_a_small_form_reports_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A window that a price makes too long is planned once; a second run plans nothing."""
    words = ["--vehicles", "20", "--windows", "5,30", "--prices", "10", "--trucks", "0"]
    words += ["--json", "--out", str(tmp_path)]
    main(words)
    first = json.loads(capsys.readouterr().out)
    assert len(first["results"]) == 4
    assert len(list((tmp_path / "cells").iterdir())) == 4
    main(words)
    again = capsys.readouterr()
    assert json.loads(again.out)["results"] == first["results"]
    assert again.err == ""
    assert "Waiting at 10 kW" in (tmp_path / "report.md").read_text()
