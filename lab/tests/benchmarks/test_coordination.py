"""The coordination benchmark: a cell, its aims, and the short form, gone on with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lab.tests.research.coordination.fakes import result
from slipstream_lab.benchmarks.coordination.bench import (
    CoordinationBenchForm,
    CoordinationBenchSettings,
    run_bench,
)
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


@pytest.mark.nightly
def test_a_small_form_reports_and_goes_on(tmp_path: Path) -> None:
    """A window that a price makes too long is planned once; a second run plans nothing."""
    form = CoordinationBenchForm(vehicles=(20,), windows_min=(5, 30), prices_kw=(10,), trucks=0)
    said: list[str] = []
    first = run_bench(CoordinationBenchSettings(tmp_path, form), said.append)
    assert len(first) == 4
    assert len(list((tmp_path / "cells").iterdir())) == 2
    said.clear()
    assert run_bench(CoordinationBenchSettings(tmp_path, form), said.append) == first
    assert said == []
    assert "Waiting at 10 kW" in (tmp_path / "report.md").read_text()
