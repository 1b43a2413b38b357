from __future__ import annotations

import math

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.planning.roads.charge import Battery, battery_of, charges_kwh, shortfall_kwh
from dispatcher_daemon.planning.roads.routes import Charging, RoadLeg, empty_leg


def leg(charging: Charging | None = None) -> RoadLeg:
    """A leg of no length."""
    empty = empty_leg("a", "b")
    return RoadLeg(empty.start, empty.end, (), 0.0, empty.drive, None, charging)


def test_charge_falls_by_each_leg_and_rises_at_charging_stops() -> None:
    """By hand: 10 − 4 = 6, 6 + 3 = 9, 9 − 8 = 1; a battery takes no more than it holds."""
    battery = Battery(10.0, 2.0, 10.0)
    legs = [leg(Charging(3.0, 60.0)), leg()]
    assert charges_kwh(battery, legs, [4.0, 8.0], 10.0) == [10.0, 6.0, 1.0]
    assert shortfall_kwh(battery, legs, [4.0, 8.0], 10.0) == pytest.approx(1.0)
    assert shortfall_kwh(battery, legs, [4.0, 7.0], 10.0) == 0.0
    assert charges_kwh(battery, [leg(Charging(30.0, 60.0)), leg()], [4.0, 1.0], 10.0)[-1] == 9.0


def test_a_vehicle_charges_while_it_waits_at_its_depot() -> None:
    """At the less of what depot and vehicle allow, until it is full."""
    own_type = {"battery_kwh": 40.0, "battery_reserve": 0.25, "charging_power_kw": 11.0}
    fleet = Fleet.model_validate(
        {
            "depots": [{"node": "x", "charging_power_kw": 22.0}],
            "stops": [{"id": "s", "node": "y"}],
            "vehicles": [{"id": "v", "own_type": own_type, "charge_kwh": 20.0}, {"id": "car"}],
        }
    )
    battery = battery_of(fleet, fleet.vehicles[0])
    assert battery == Battery(40.0, 10.0, 20.0, 11.0, 11.0)
    assert battery.at_departure_kwh(0.0) == battery.at_departure_kwh(-5.0) == 20.0
    assert battery.at_departure_kwh(3600.0) == pytest.approx(31.0)
    assert battery.at_departure_kwh(1e6) == 40.0
    assert battery.charging_s(11.0, 150.0) == pytest.approx(3600.0)
    assert math.isfinite(battery.charging_s(1.0, 5.0))
    assert battery_of(fleet, fleet.vehicles[1]) is None
