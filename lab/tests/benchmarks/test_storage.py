"""The benchmark of the storage: what it stores can be found, and its aims follow the figures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from slipstream_lab.benchmarks.storage import __main__ as command
from slipstream_lab.benchmarks.storage.bench import StorageFigures, checks
from slipstream_lab.benchmarks.storage.city import StoredCity
from storage import open_database, open_reader


def test_its_city_is_stored_as_it_is(tmp_path: Path) -> None:
    """A cycle comes back, gates change from one to the next, and each minute has all segments."""
    city, again = StoredCity(50), StoredCity(50)
    first, second = city.cycle(1), city.cycle(2)
    assert again.cycle(1) == first
    changed = sum(
        a.open != b.open for a, b in zip(first.report.gates, second.report.gates, strict=True)
    )
    assert 0 < changed < 25
    url = f"sqlite:///{tmp_path}/x.db"
    with open_database(url) as database, open_reader(url) as reader:
        for cycle in (first, second):
            database.record_cycle(cycle.report, cycle.plans, cycle.states)
            database.add_rollups(cycle.minutes)
        assert reader.cycles(9) == (first.report, second.report)
        segment = first.states[0].segment
        minutes = reader.rollups(segment, 0, 2**62)
        assert [part.count for part in minutes] == [60] * 10
        (part, *_) = reader.segments_at(second.report.started_ns + 1)
        assert part.rollup is None
        (part, *_) = reader.segments_at(second.report.started_ns - 1)
        assert part.rollup in minutes


@pytest.mark.nightly
def test_the_short_form_measures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A day of a few segments: figures of each query, and no aim of size for so little."""
    arguments = ["--short", "--segments", "3", "--only", "sqlite", "--out", str(tmp_path), "--json"]
    assert command.main(arguments) in (0, 1)
    (figures,) = json.loads(capsys.readouterr().out)["databases"]
    assert figures["days"] == 1
    assert len(figures["queries_ms"]) == 9
    assert 0 < figures["gb"] < 0.1


def test_aims_of_size_need_a_lasting_growth() -> None:
    """Sizes of later days follow from the growth, but not from days in which minutes pile up."""
    short = StorageFigures(
        "SQLite", 1, 1000, 0.4, 0.4, (1, 2), (1, 2), (1, 2), 3, {"one": 4.0}, (1, 2), {"one": 3.0}
    )
    assert [check.reached for check in checks(short)] == [None, None, True, True]
    some = replace(short, days=5, gb=0.8, gb_a_day=0.04)
    assert some.gb_after(30) == pytest.approx(1.8)
    assert [check.reached for check in checks(some)] == [True] * 4
    whole = replace(short, days=30, gb=1.9, gb_a_day=0.01)
    assert [check.reached for check in checks(whole)] == [True] * 4
    slow = replace(whole, gb=2.1, gb_a_day=0.1, backlog_ms=101.0, queries_ms={"one": 51.0})
    assert [check.reached for check in checks(slow)] == [False] * 4
