"""The energy ledger: parts add up by hour and vehicle, and go when their cycles have gone."""

from __future__ import annotations

import csv
import sqlite3
from dataclasses import astuple, replace
from datetime import UTC, datetime

import pytest

import storage
from slipstream.energy.ledger import EnergyHour, EnergySum, PlanEnergy
from slipstream.orders import FleetRecords, PlanRecord, VehicleRecord
from slipstream_cli.main import main

HOUR_NS = 3600 * 10**9
DAY_NS = 24 * HOUR_NS
BEGIN_NS = 1_790_000_000_000_000_000 // DAY_NS * DAY_NS
ENERGY = PlanEnergy((0.25, 0.125), (0.0, 0.0625), -0.03125, 0.5, 0.25)


def _hour(number: int, vehicle: str, factor: float = 1.0) -> EnergyHour:
    figures = (2.0, 1.0, 0.25, 0.5, 0.25, 8000.0, 2000.0)
    return EnergyHour(BEGIN_NS + number * HOUR_NS, vehicle, *(factor * f for f in figures))


def _figures(*parts: EnergyHour) -> tuple[float, ...]:
    return tuple(map(sum, zip(*(astuple(part)[2:] for part in parts), strict=True)))


@pytest.mark.slow
def test_parts_add_up(any_url):
    """What comes later of an hour and vehicle is added to what is there; sums are over all."""
    parts = [_hour(0, "a"), _hour(0, "b", 2.0), _hour(1, "a"), _hour(25, "a", 4.0)]
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        assert reader.energy_sums(0, 2**62, by="all") == ()
        database.save_fleet(FleetRecords(driven=(*parts, _hour(1, "a"))))
        database.save_fleet(FleetRecords(driven=(_hour(0, "b", 3.0),)))
        stored = (_hour(0, "a"), _hour(0, "b", 5.0), _hour(1, "a", 2.0), _hour(25, "a", 4.0))
        assert reader.energy(0, 2**62) == stored
        assert reader.energy(BEGIN_NS, BEGIN_NS + HOUR_NS, vehicle="b") == stored[1:2]
        assert reader.energy(BEGIN_NS + 1, BEGIN_NS + 25 * HOUR_NS) == stored[2:3]
        hours = reader.energy_sums(0, 2**62, by="hour")
        assert [s.begin_ns for s in hours] == [BEGIN_NS + n * HOUR_NS for n in (0, 1, 25)]
        assert hours[0] == EnergySum(BEGIN_NS, *_figures(*stored[:2]))
        days = reader.energy_sums(0, 2**62, by="day")
        assert days == (
            EnergySum(BEGIN_NS, *_figures(*stored[:3])),
            EnergySum(BEGIN_NS + DAY_NS, *_figures(stored[3])),
        )
        assert reader.energy_sums(7, 2**62, by="all") == (EnergySum(7, *_figures(*stored)),)


def test_plans_keep_their_energy_and_vehicles_how_far_they_are_booked(any_url, make_cycle):
    """A dispatcher that starts finds both; plans that came without have none."""
    report, plans, states = make_cycle(1)
    first, second = plans
    with storage.open_database(any_url) as database:
        database.record_cycle(report, plans, states, energies={first.vehicle: ENERGY})
        booked = PlanRecord(first, "acknowledged", 7, energy=ENERGY)
        vehicle = VehicleRecord(first.vehicle, {}, {}, booked=1.375)
        database.save_fleet(FleetRecords(plans=(booked,), vehicles=(vehicle,)))
    with storage.open_database(any_url) as database:
        found = database.load_fleet(0)
        assert found.plans == (booked, PlanRecord(second, "published", report.started_ns))
        assert found.vehicles == (vehicle,)


def test_hours_go_with_their_cycles(any_url, make_cycle, monkeypatch):
    """Hours that ended before the first cycle that is kept are deleted, some at a time."""
    monkeypatch.setattr("storage.records.energy_ledger.ROWS_A_STEP", 2)
    report, plans, states = make_cycle(1)
    report = report.model_copy(update={"started_ns": BEGIN_NS + 3 * HOUR_NS + 1})
    driven = tuple(_hour(n, vehicle) for n in range(6) for vehicle in "ab")
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(report, plans, states, FleetRecords(driven=driven))
        database.tidy(report.started_ns)
        assert reader.energy(0, 2**62) == driven[6:]


def test_a_cycle_that_fails_books_nothing(any_url, make_cycle):
    """The ledger is part of the cycle's transaction."""
    records = FleetRecords(driven=(_hour(0, "a"),))
    with storage.open_database(any_url) as database, storage.open_reader(any_url) as reader:
        database.record_cycle(*make_cycle(1), records)
        with pytest.raises(ValueError, match="refused"):
            database.record_cycle(*make_cycle(1), replace(records, driven=(_hour(1, "a"),)))
        assert reader.energy(0, 2**62) == records.driven


@pytest.mark.slow
def test_a_damaged_file_hands_on_what_is_booked(url, make_cycle):
    """Plans in force that are taken over are booked on from where they were."""
    report, plans, states = make_cycle(1)
    booked = PlanRecord(plans[0], "acknowledged", 7, energy=ENERGY)
    vehicle = VehicleRecord(plans[0].vehicle, {}, {}, booked=0.5)
    energies = {plans[0].vehicle: ENERGY}
    with storage.open_or_set_aside(url) as database:
        database.record_cycle(report, plans, states, energies=energies)
        database.save_fleet(FleetRecords(plans=(booked,), vehicles=(vehicle,)))
    path = url.removeprefix("sqlite:///")
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA writable_schema=ON")
        # A page that belongs to nothing: all rows can be read.
        connection.execute("DELETE FROM sqlite_master WHERE name='ix_orders_state'")
    connection.close()
    with storage.open_or_set_aside(url) as database:
        assert database.set_aside is not None
        found = database.load_fleet(0)
        assert (found.plans[0], found.vehicles) == (booked, (vehicle,))


@pytest.mark.slow
def test_the_ledger_is_exported(url, tmp_path, make_cycle):
    """`slipstream export energy_ledger` gives its rows for a time range."""
    with storage.open_database(url) as database:
        database.record_cycle(*make_cycle(1), FleetRecords(driven=(_hour(0, "a"), _hour(1, "a"))))
    start = datetime.fromtimestamp((BEGIN_NS + HOUR_NS) // 10**9, UTC).isoformat()
    main(["export", "energy_ledger", "--out", str(tmp_path), "--database", url, "--from", start])
    with (tmp_path / "energy_ledger.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["hour_ns"], row["vehicle"]) == (str(BEGIN_NS + HOUR_NS), "a")
    assert float(row["plan_kwh"]) == 1.0
