"""Charge of a vehicle's battery along a route, as planned: without drafting, by its own type."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.fleet import Fleet, Vehicle
from dispatcher_daemon.planning.roads.routes import RoadLeg
from slipstream.energy.consumption import VehicleParameters, drive_energy_kwh

_S_PER_H: Final = 3600.0
TOLERANCE_KWH: Final = 1e-6


@dataclass(frozen=True)
class Battery:
    """A vehicle's battery and where it stands at the fleet's reference time.

    Attributes:
        capacity_kwh: usable.
        reserve_kwh: below which no plan goes.
        charge_kwh: at the reference time.
        power_kw: most that it takes; inf: what the place gives.
        depot_power_kw: at which it charges while it waits at its depot; 0: it cannot.
    """

    capacity_kwh: float
    reserve_kwh: float
    charge_kwh: float
    power_kw: float = math.inf
    depot_power_kw: float = 0.0

    def at_departure_kwh(self, after_s: float) -> float:
        """Charge when it leaves its depot some time after the reference time."""
        taken_kwh = self.depot_power_kw * max(0.0, after_s) / _S_PER_H
        return min(self.capacity_kwh, self.charge_kwh + taken_kwh)

    def charging_s(self, energy_kwh: float, place_kw: float) -> float:
        """Time to take energy in, at one power throughout."""
        return energy_kwh / min(place_kw, self.power_kw) * _S_PER_H


def battery_of(fleet: Fleet, vehicle: Vehicle) -> Battery | None:
    """A vehicle's battery; None: its type has none."""
    kind = fleet.type_of(vehicle)
    if kind is None or kind.battery_kwh is None:
        return None
    charge_kwh = kind.battery_kwh
    if vehicle.charge_kwh is not None:
        # A vehicle's own measurement may exceed what its type is said to hold.
        charge_kwh = min(charge_kwh, vehicle.charge_kwh)
    power_kw = math.inf if kind.charging_power_kw is None else kind.charging_power_kw
    place_kw = fleet.depot_of(vehicle).charging_power_kw
    return Battery(
        kind.battery_kwh,
        kind.battery_reserve * kind.battery_kwh,
        charge_kwh,
        power_kw,
        0.0 if place_kw is None else min(place_kw, power_kw),
    )


def leg_energy_kwh(leg: RoadLeg, physics: VehicleParameters) -> float:
    """Energy that a leg takes out of the battery, every vehicle driving alone."""
    return drive_energy_kwh(leg.drive, physics) + leg.beyond_kwh


def charges_kwh(
    battery: Battery, legs: Sequence[RoadLeg], energies_kwh: Sequence[float], departure_kwh: float
) -> list[float]:
    """Charge at the departure and on arrival at the end of each leg, below 0 where it is empty."""
    charge = departure_kwh
    found = [charge]
    for leg, energy in zip(legs, energies_kwh, strict=True):
        charge -= energy
        found.append(charge)
        if leg.charging is not None:
            charge = min(battery.capacity_kwh, charge + leg.charging.energy_kwh)
    return found


def shortfall_kwh(
    battery: Battery, legs: Sequence[RoadLeg], energies_kwh: Sequence[float], departure_kwh: float
) -> float:
    """By how much the charge falls below the reserve; 0: it does not."""
    lowest = min(charges_kwh(battery, legs, energies_kwh, departure_kwh)[1:], default=math.inf)
    short = battery.reserve_kwh - lowest
    return short if short > TOLERANCE_KWH else 0.0
