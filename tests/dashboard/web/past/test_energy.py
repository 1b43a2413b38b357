"""Energy by hour and day, of this day and week, and since the start."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest

import storage
from dashboard.settings import Factors
from dashboard.web import energy
from dashboard.web.energy import EnergyBook
from slipstream.energy.ledger import EnergyHour
from slipstream.messages import CycleReport, EnergySummary
from slipstream.orders import FleetRecords

BERLIN = ZoneInfo("Europe/Berlin")
FACTORS = Factors(co2_kg_per_kwh=0.4, price_per_kwh=0.25)
SUMMARY = EnergySummary(
    baseline="independent vehicles",
    baseline_kwh=2.0,
    cooperative_kwh=1.5,
    saved_distance_kwh=0.1,
    saved_drag_kwh=0.3,
    saved_acceleration_kwh=0.1,
    platooned_distance_m=4000.0,
)


def at(text: str) -> int:
    """UTC ns of a time of UTC."""
    return round(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()) * 10**9


def hour(text: str, vehicle: str = "van-a") -> EnergyHour:
    """An hour in which a vehicle drove 10 km, 4 of them in platoons, for 1.5 of 2 kWh."""
    return EnergyHour(at(text), vehicle, 2.0, 1.5, 0.1, 0.3, 0.1, 10_000.0, 4_000.0)


def report(number: int, text: str, summary: EnergySummary | None) -> CycleReport:
    """A cycle."""
    return CycleReport(
        cycle=number,
        started_ns=at(text),
        wall_s=1.0,
        status="ok",
        reason=None,
        solver="exact",
        objective_kwh=1.0,
        variables=3,
        solvers=(),
        gates=(),
        energy=summary,
        plans=0,
    )


@pytest.fixture
def database(tmp_path: Path) -> Iterator[storage.Database]:
    """An empty one."""
    with storage.open_database(f"sqlite:///{tmp_path / 'a.db'}") as found:
        yield found


@pytest.fixture
def reader(database: storage.Database, tmp_path: Path) -> Iterator[storage.Reader]:
    """Of that database."""
    with storage.open_reader(f"sqlite:///{tmp_path / 'a.db'}") as found:
        yield found


def test_days_and_weeks_begin_in_the_pages_zone() -> None:
    """Also where the clocks are changed, and where the day of UTC is another one."""
    # Sunday, 25 October 2026: summer time ends at 01:00 UTC.
    assert energy.day_begins(at("2026-10-25T12:00"), BERLIN) == at("2026-10-24T22:00")
    assert energy.day_begins(at("2026-10-26T12:00"), BERLIN) == at("2026-10-25T23:00")
    assert energy.day_begins(at("2026-11-22T23:30"), BERLIN) == at("2026-11-22T23:00")
    assert energy.week_begins(at("2026-10-25T12:00"), BERLIN) == at("2026-10-18T22:00")
    assert energy.week_begins(at("2026-10-26T12:00"), BERLIN) == at("2026-10-25T23:00")


def test_nothing_driven_is_nothing(reader: storage.Reader) -> None:
    """A database without a ledger, or none at all, has no figures."""
    found = EnergyBook(reader, BERLIN, FACTORS).at(at("2026-11-22T12:00"))
    assert set(found.values()) == {None}


@pytest.mark.slow
def test_sums_until_a_moment(database: storage.Database, reader: storage.Reader) -> None:
    """Of its day, its week, and since the start; what came later does not count."""
    database.record_cycle(report(1, "2026-11-18T08:00", SUMMARY), [], [])
    database.record_cycle(report(2, "2026-11-18T18:00", None), [], [])
    database.save_fleet(
        FleetRecords(
            driven=(
                hour("2026-11-01T09:00"),
                hour("2026-11-16T09:00"),
                hour("2026-11-18T08:00"),
                hour("2026-11-18T08:00", "van-b"),
                hour("2026-11-18T17:00"),
                hour("2026-11-19T08:00"),
            )
        )
    )
    book = EnergyBook(reader, BERLIN, FACTORS)
    found = book.at(at("2026-11-18T18:30"))
    assert found["since"] == at("2026-11-01T09:00") // 10**6
    assert [found[key]["plan_kwh"] for key in ("today", "week", "total")] == [4.5, 6.0, 7.5]
    assert found["today"] == {
        "baseline": "independent vehicles",
        "baseline_kwh": 6.0,
        "plan_kwh": 4.5,
        "saved_kwh": 1.5,
        "saved_share": 0.25,
        "distance_kwh": 0.3,
        "drag_kwh": 0.9,
        "acceleration_kwh": 0.3,
        "km": 30.0,
        "platoon_km": 12.0,
        "co2_kg": 0.6,
        "money": 0.38,
    }
    # The last cycle drove nothing: the figures of the one before stay.
    assert found["last_cycle"]["saved_kwh"] == 0.5
    # The same book tells of earlier moments and later ones: of half an hour the half.
    early = book.at(at("2026-11-18T08:30"))
    assert (early["today"]["plan_kwh"], early["total"]["plan_kwh"]) == (1.5, 4.5)
    assert book.at(at("2026-11-18T09:00"))["today"]["plan_kwh"] == 3.0
    assert book.at(at("2026-11-19T12:00"))["total"]["plan_kwh"] == 9.0
    assert book.at(at("2026-11-25T12:00"))["today"]["plan_kwh"] == 0.0
    assert book.at(at("2026-11-25T12:00"))["total"]["plan_kwh"] == 9.0
    assert book.at(at("2026-11-01T09:10"))["total"]["plan_kwh"] == 0.25
    assert book.at(at("2026-11-01T08:10"))["total"] is None


def test_rows_by_hour_and_day(database: storage.Database, reader: storage.Reader) -> None:
    """Days are those of the zone; the last hour of the evening belongs to it."""
    driven = hour("2026-11-18T22:00"), hour("2026-11-18T23:00"), hour("2026-11-18T23:00", "van-b")
    database.save_fleet(FleetRecords(driven=driven))
    book = EnergyBook(reader, BERLIN, FACTORS)
    begin_ns, end_ns = at("2026-11-17T23:00"), at("2026-11-19T23:00")
    hours = book.rows(begin_ns, end_ns, "hour")
    assert [(row["t"], row["km"]) for row in hours] == [
        (at("2026-11-18T22:00") // 10**6, 10.0),
        (at("2026-11-18T23:00") // 10**6, 20.0),
    ]
    days = book.rows(begin_ns, end_ns, "day")
    assert [(row["t"], row["km"]) for row in days] == [
        (at("2026-11-17T23:00") // 10**6, 10.0),
        (at("2026-11-18T23:00") // 10**6, 20.0),
    ]
