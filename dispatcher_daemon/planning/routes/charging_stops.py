"""Charging stops on a vehicle's route, where its battery does not last without them.

The order of stops is given. Each leg may lead over at most one charging stop, at which the vehicle
takes what the rest of its route needs, or fills its battery; charging is linear in time. Among
these routes the one of least time is found by labels of time and charge (the fixed-route
vehicle-charging problem: Montoya, Guéret, Mendoza and Villegas, Transportation Research Part B 103,
2017).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import RoadLeg, Travel
from dispatcher_daemon.planning.roads.charge import (
    TOLERANCE_KWH,
    Battery,
    battery_of,
    leg_energy_kwh,
    shortfall_kwh,
)
from dispatcher_daemon.planning.roads.routes import Charging
from slipstream.energy.consumption import VehicleParameters

MAX_LABELS = 64
"""Kept at each stop of a route."""


@dataclass(frozen=True)
class _Label:
    """One way to a stop: time beyond the direct one, charge on arrival, legs."""

    extra_s: float
    charge_kwh: float
    legs: tuple[RoadLeg, ...]


class Batteries:
    """What a fleet's batteries allow of its routes.

    Attributes:
        of: by vehicle number; None: its charge is not looked at.
    """

    def __init__(self, problem: RoutingProblem) -> None:
        self._problem = problem
        self.of = [battery_of(problem.fleet, v) for v in problem.fleet.vehicles]
        self._energies_kwh: dict[tuple[VehicleParameters, tuple[str, ...], float], float] = {}

    def with_stops(
        self, number: int, travel: Travel, legs: Sequence[RoadLeg], fixed: int, *, under_way: bool
    ) -> list[RoadLeg] | None:
        """The legs of a route, over charging stops where they are needed; None: it does not last.

        Args:
            under_way: whether the vehicle goes on as it can.
        """
        battery = self.of[number]
        if battery is None:
            return list(legs)
        fleet, energy_kwh = self._problem.fleet, self._energy_kwh(number)
        ready_kwh = battery.charge_kwh
        if not under_way:
            ready_kwh = battery.at_departure_kwh(fleet.vehicles[number].ready_s)
        found = with_charging_stops(battery, fleet, travel, legs, ready_kwh, energy_kwh, fixed)
        # Charged at the depot while it may wait there, it may get along without.
        if found is None and (under_way or battery.depot_power_kw > 0):
            return list(legs)
        return found

    def needed_h(self, number: int, legs: Sequence[RoadLeg]) -> float:
        """How long a vehicle has to charge at its depot for a route, h; inf: it does not last."""
        battery = self.of[number]
        if battery is None:
            return 0.0
        energies_kwh = [self._energy_kwh(number)(leg) for leg in legs]
        charge_kwh = battery.at_departure_kwh(self._problem.fleet.vehicles[number].ready_s)
        short_kwh = shortfall_kwh(battery, legs, energies_kwh, charge_kwh)
        if short_kwh == 0.0:
            return 0.0
        if battery.depot_power_kw == 0 or charge_kwh + short_kwh > battery.capacity_kwh:
            return math.inf
        return short_kwh / battery.depot_power_kw

    def _energy_kwh(self, number: int) -> Callable[[RoadLeg], float]:
        physics = self._problem.profile_of(self._problem.fleet.vehicles[number]).physics

        def energy_kwh(leg: RoadLeg) -> float:
            # The rest of a leg has the path of the whole one.
            key = physics, leg.path, leg.drive.duration_s
            if key not in self._energies_kwh:
                self._energies_kwh[key] = leg_energy_kwh(leg, physics)
            return self._energies_kwh[key]

        return energy_kwh


def with_charging_stops(
    battery: Battery,
    fleet: Fleet,
    travel: Travel,
    legs: Sequence[RoadLeg],
    departure_kwh: float,
    energy_kwh: Callable[[RoadLeg], float],
    fixed: int = 0,
) -> list[RoadLeg] | None:
    """The legs of a route, over charging stops where the battery needs them.

    Args:
        legs: from depot to depot, without charging stops.
        fixed: number of legs at the beginning that stay as they are.

    Returns:
        None if the charge falls below the reserve in any case.
    """
    needs = [energy_kwh(leg) for leg in legs]
    if departure_kwh - sum(needs) >= battery.reserve_kwh - TOLERANCE_KWH:
        return list(legs)

    def over_charging_stops(leg: RoadLeg, label: _Label, after_kwh: float) -> Iterator[_Label]:
        for place in fleet.charging_stops:
            there, on = travel.leg(leg.start, place.id), travel.leg(place.id, leg.end)
            if there is None or on is None:
                continue
            arrival_kwh = label.charge_kwh - energy_kwh(there)
            on_kwh = energy_kwh(on)
            # The exact need of the rest, unless the battery does not hold it.
            target_kwh = min(battery.capacity_kwh, after_kwh + on_kwh)
            taken_kwh = target_kwh - arrival_kwh
            if arrival_kwh < battery.reserve_kwh - TOLERANCE_KWH or taken_kwh <= 0:
                continue
            if target_kwh - on_kwh < battery.reserve_kwh - TOLERANCE_KWH:
                continue
            charging = Charging(taken_kwh, battery.charging_s(taken_kwh, place.power_kw))
            detour_s = there.drive.duration_s + on.drive.duration_s - leg.drive.duration_s
            yield _Label(
                label.extra_s + detour_s + charging.duration_s,
                target_kwh - on_kwh,
                (*label.legs, replace(there, charging=charging), on),
            )

    labels = [_Label(0.0, departure_kwh, ())]
    for number, (leg, need) in enumerate(zip(legs, needs, strict=True)):
        after_kwh = battery.reserve_kwh + sum(needs[number + 1 :])
        found = []
        for label in labels:
            charge = label.charge_kwh - need
            if charge >= battery.reserve_kwh - TOLERANCE_KWH:
                found.append(_Label(label.extra_s, charge, (*label.legs, leg)))
            if number < fixed:
                continue
            found += over_charging_stops(leg, label, after_kwh)
        labels = _undominated(found)
        if not labels:
            return None
    return list(labels[0].legs)


def _undominated(labels: Sequence[_Label]) -> list[_Label]:
    """Those that no other beats in both time and charge, the quickest first."""
    kept: list[_Label] = []
    for label in sorted(labels, key=lambda label: (label.extra_s, -label.charge_kwh)):
        if not kept or label.charge_kwh > kept[-1].charge_kwh + TOLERANCE_KWH:
            kept.append(label)
    return kept[:MAX_LABELS]
