"""Counted vehicles: a quarter hour is stored once, exported, and kept as long as cycles."""

from __future__ import annotations

import csv
import sqlite3
from contextlib import closing

import msgspec
import pytest

import storage
from slipstream.messages import ClassCount, Estimate, SegmentCounts
from slipstream_cli.main import main
from storage import schema

QUARTER_NS = 900 * 10**9
BEGAN_NS = 1_790_000_000 * 10**9 // QUARTER_NS * QUARTER_NS


def _counts(segment="avenue", number=0, **changed):
    """One complete quarter hour, the n-th of the day."""
    told = SegmentCounts(
        rsu="cam-1",
        segment=segment,
        began_ns=BEGAN_NS + number * QUARTER_NS,
        until_ns=BEGAN_NS + (number + 1) * QUARTER_NS,
        complete=True,
        watched_s=870.25,
        reason="dark",
        vehicles=Estimate(value=48.0, standard_error=1.58),
        classes=tuple(
            ClassCount(vehicle_class=name, vehicles=Estimate(value=value, standard_error=1.5))
            for name, value in (("car", 38.0), ("truck", 6.0), ("bus", 1.0), ("motorcycle", 3.0))
        ),
        mean_speed_mps=Estimate(value=16.7, standard_error=0.05),
        v85_mps=None,
        speeds=47,
    )
    return msgspec.structs.replace(told, **changed)


def test_what_is_stored_comes_back(any_url):
    """By segment and time, oldest first; an RSU's name may have any character."""
    with storage.open_database(any_url) as database:
        database.add_counts([_counts(number=n) for n in (2, 0, 1)])
        database.add_counts([_counts("street", rsu="n.1 ü\0")])
        database.add_counts([])
    with storage.open_reader(any_url) as reader:
        of_avenue = reader.counts("avenue", BEGAN_NS, BEGAN_NS + 2 * QUARTER_NS)
        (of_street,) = reader.counts("street", 0, 2**62)
    assert of_avenue == (_counts(number=0), _counts(number=1))
    assert of_street.rsu == "n.1 ü\N{REPLACEMENT CHARACTER}"


def test_repeats_change_nothing_but_for_more_watched_time(any_url):
    """After a clock was set back a quarter hour is told twice."""
    half = _counts(watched_s=400.0, vehicles=Estimate(value=20.0, standard_error=1.0))
    with storage.open_database(any_url) as database:
        database.add_counts([half])
        database.add_counts([_counts(), half])
        database.add_counts([half])
        database.add_counts([_counts()])
    with storage.open_reader(any_url) as reader:
        assert reader.counts("avenue", 0, 2**62) == (_counts(),)


@pytest.mark.slow
def test_they_go_with_the_cycles(any_url, make_cycle):
    """Those that ended before the first cycle that is kept."""
    report, plans, states = make_cycle(1)
    began_ns = report.started_ns // QUARTER_NS * QUARTER_NS
    told = [
        _counts(began_ns=began_ns + n * QUARTER_NS, until_ns=began_ns + (n + 1) * QUARTER_NS)
        for n in (-2, -1, 0)
    ]
    with storage.open_database(any_url) as database:
        database.add_counts(told)
        database.record_cycle(report, plans, states)
        database.tidy(report.started_ns)
    with storage.open_reader(any_url) as reader:
        assert reader.counts("avenue", 0, 2**62) == (told[-1],)


def test_export_gives_them_as_csv_with_errors_and_watched_time(url, tmp_path):
    """Those of the range of time."""
    with storage.open_database(url) as database:
        database.add_counts([_counts(number=n) for n in range(3)])
    begin = "2026-09-21T13:20:00Z"
    arguments = ["export", "segment_counts", "--database", url, "--from", begin]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    with (tmp_path / "segment_counts.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    row = rows[0]
    assert (row["segment"], row["rsu"], row["reason"]) == ("avenue", "cam-1", "dark")
    assert float(row["vehicles"]) == 48
    assert float(row["truck_error"]) == 1.5
    assert float(row["watched_s"]) == 870.25
    assert float(row["flow_vph"]) == pytest.approx(48 / 870.25 * 3600)
    assert float(row["flow_vph_error"]) > 0
    assert row["v85_mps"] == ""


def test_a_database_of_before_gets_the_table(url):
    """The upgrade makes the same table as a new database has."""
    storage.open_database(url).close()
    path = url.removeprefix("sqlite:///")
    query = "SELECT name, type, \"notnull\", pk FROM pragma_table_info('segment_counts')"
    with closing(sqlite3.connect(path)) as old:
        expected = old.execute(query).fetchall()
        old.execute("DROP TABLE segment_counts")
        old.execute("UPDATE alembic_version SET version_num = '0021'")
        old.commit()
    with storage.open_database(url) as database:
        database.add_counts([_counts()])
    with closing(sqlite3.connect(path)) as new:
        assert new.execute(query).fetchall() == expected
        (version,) = new.execute("SELECT version_num FROM alembic_version").fetchone()
        assert version == schema.HEAD
