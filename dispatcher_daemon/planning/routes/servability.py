"""Stops that no vehicle can serve, with the reasons; the rest of the fleet is routed."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from dispatcher_daemon.fleet import Fleet, Stop, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import RoadLeg, Travel, fleet_travel
from dispatcher_daemon.planning.roads.charge import battery_of, leg_energy_kwh
from dispatcher_daemon.planning.routes.charging_stops import with_charging_stops
from dispatcher_daemon.traffic import TrafficSnapshot

NO_WAY: Final = "node "
WINDOW_CLOSES: Final = "its window closes"
"""Begins of reasons that are not for want of a free vehicle."""
_TOLERANCE_S = 2.0
"""Durations of paths are known to about a second; a doubtful stop is left to the planner."""


@dataclass(frozen=True, order=True)
class _Refusal:
    """Why one vehicle cannot serve a stop; ordered by how near it is to serving it.

    Attributes:
        short: the same of this vehicle alone, which is not named.
    """

    stage: int
    closeness: float
    reason: str
    short: str


def servable_part(
    problem: RoutingProblem, snapshot: TrafficSnapshot
) -> tuple[RoutingProblem | None, dict[str, str]]:
    """(the problem without stops that no vehicle can serve, these with the reason).

    A vehicle whose first stop is among them has none. The problem is None if no stop is left.
    """
    missing = unservable(problem, snapshot)
    if not missing:
        return problem, {}
    if len(missing) == len(problem.fleet.stops):
        return None, missing
    return without(problem, missing), missing


def without(problem: RoutingProblem, stops: Collection[str]) -> RoutingProblem:
    """The problem without some, but not all stops; who has one as first stop has none."""
    fleet = problem.fleet
    vehicles = tuple(
        v.model_copy(update={"first_stop": None}) if v.first_stop in stops else v
        for v in fleet.vehicles
    )
    kept = tuple(stop for stop in fleet.stops if stop.id not in stops)
    # Not a copy: what a fleet has looked up of its stops would be copied with it.
    smaller = Fleet(**fleet.parts | {"stops": kept, "vehicles": vehicles})
    return replace(problem, fleet=smaller)


def unservable(
    problem: RoutingProblem, snapshot: TrafficSnapshot, travel: Travel | None = None
) -> dict[str, str]:
    """Stops that no vehicle could serve even if it served nothing else, with the reason.

    A vehicle drives the least-energy paths from its depot over its first stop, if that can be
    served, to the stop and back. A stop that is loaded on a vehicle is that
    vehicle's alone.

    Returns:
        Reason by stop, in the fleet's order: it cannot be reached or left again, its demand is
        above every capacity, no vehicle here may serve it, its window closes before anyone
        arrives, nobody who serves it is back in time, or no battery lasts.
    """
    fleet = problem.fleet
    travel = travel or fleet_travel(problem, snapshot)
    loaded = {v.first_stop: v for v in fleet.vehicles if v.first_stop is not None}
    found: dict[str, str] = {}
    lost: set[str] = set()
    for name, vehicle in loaded.items():
        refusal = _refusal(problem, travel, vehicle, [fleet.stop_by_id[name]])
        if refusal is not None:
            lost.add(name)
            found[name] = f"{refusal.reason}; it is loaded on {vehicle.id!r}"
    pooled = [fleet.stop_by_id[name] for name in fleet.pooled]
    kinds = _kinds(fleet, lost, {stop.vehicle for stop in pooled})
    for stop in pooled:
        anybody = False
        nearest: _Refusal | None = None
        # Mostly the first one can: who else may is not asked.
        for vehicle in kinds:
            if not fleet.may_serve(vehicle, stop):
                continue
            anybody = True
            first = vehicle.first_stop
            before = [] if first is None or first in lost else [fleet.stop_by_id[first]]
            refusal = _refusal(problem, travel, vehicle, [*before, stop])
            if refusal is None:
                nearest = None
                break
            nearest = refusal if nearest is None else max(nearest, refusal)
        if not anybody:
            found[stop.id] = _whom_it_needs(stop)
        if nearest is not None:
            whose = "" if stop.carrier is None else f"; it is of carrier {stop.carrier!r}"
            found[stop.id] = nearest.reason + whose
    return {stop.id: found[stop.id] for stop in fleet.stops if stop.id in found}


def obstacles(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    vehicles: Collection[str],
    stops: Collection[str],
) -> dict[str, dict[str, str]]:
    """What keeps each of some vehicles without work from each of some stops, by stop, in words."""
    fleet = problem.fleet
    idle = [vehicle for vehicle in fleet.vehicles if vehicle.id in vehicles]
    kept = {*stops, *(vehicle.first_stop for vehicle in idle)}
    others = [stop.id for stop in fleet.stops if stop.id not in kept]
    problem = without(problem, others) if others else problem
    travel, fleet = fleet_travel(problem, snapshot), problem.fleet
    first = {v.id: [fleet.stop_by_id[v.first_stop]] if v.first_stop else [] for v in idle}

    def obstacle(vehicle: Vehicle, stop: Stop) -> str:
        if stop.vehicle not in (None, vehicle.id):
            return f"kept for {stop.vehicle}"
        if lacks := [skill for skill in stop.skills if skill not in vehicle.skills]:
            return f"lacks {', '.join(lacks)}"
        if not fleet.may_serve(vehicle, stop):
            return f"not of carrier {stop.carrier}"
        before = [one for one in first[vehicle.id] if one.id != stop.id]
        refusal = _refusal(problem, travel, vehicle, [*before, stop])
        return (
            "could serve it alone, no plan with it was found" if refusal is None else refusal.short
        )

    return {
        name: {vehicle.id: obstacle(vehicle, fleet.stop_by_id[name]) for vehicle in idle}
        for name in stops
    }


def _whom_it_needs(stop: Stop) -> str:
    if stop.vehicle is not None:
        return f"it is kept for {stop.vehicle!r}, which is not free or may not serve it"
    if stop.skills:
        which = "" if stop.carrier is None else f" of its carrier {stop.carrier!r}"
        return f"no vehicle{which} with the skills {', '.join(stop.skills)} is free"
    return f"no vehicle of its carrier {stop.carrier!r} is free"


def _kinds(fleet: Fleet, lost: set[str], kept_for: Collection[str | None]) -> list[Vehicle]:
    """One vehicle of each kind: many differ in nothing but their names."""

    def kind(vehicle: Vehicle) -> tuple[object, ...]:
        first = None if vehicle.first_stop in lost else vehicle.first_stop
        times = vehicle.ready_s, vehicle.return_by_s
        name = vehicle.id if vehicle.id in kept_for else None
        data: tuple[object, ...] = vehicle.type, vehicle.own_type, vehicle.carrier, name
        data = *data, frozenset(vehicle.skills)
        if battery_of(fleet, vehicle) is not None:
            data = *data, vehicle.charge_kwh, vehicle.depart_by_s
        return vehicle.depot, first, vehicle.capacity, *times, *data

    return list({kind(vehicle): vehicle for vehicle in fleet.vehicles}.values())


def _refusal(
    problem: RoutingProblem, travel: Travel, vehicle: Vehicle, stops: list[Stop]
) -> _Refusal | None:
    """Why a vehicle cannot serve the last of some stops after the others; None if it can."""
    depot, last = problem.fleet.depot_of(vehicle), stops[-1]
    travel = travel.of(vehicle)
    places = [depot.id, *(stop.id for stop in stops)]
    rows = [travel.row[place] for place in places]
    seconds = [float(travel.duration_s[i, j]) for i, j in pairwise(rows)]
    home_s = float(travel.duration_s[rows[-1], rows[0]])
    if not math.isfinite(sum(seconds)):
        where = f"depot {depot.id!r}" if len(stops) == 1 else f"stop {stops[-2].id!r}"
        reason = f"{NO_WAY}{last.node!r} cannot be reached from {where}{_by_whom(problem, vehicle)}"
        return _Refusal(0, 0.0, reason, "no way there")
    if not math.isfinite(home_s):
        reason = f"{NO_WAY}{last.node!r} cannot be left for depot {depot.id!r}"
        return _Refusal(1, 0.0, reason + _by_whom(problem, vehicle), "no way back")
    demand = sum(stop.demand for stop in stops)
    if vehicle.capacity is not None and demand > vehicle.capacity:
        short = vehicle.capacity - demand
        with_first = "" if len(stops) == 1 else f" (with {stops[-2].id!r} loaded)"
        nearest = f"above every capacity (nearest: {vehicle.capacity} of {vehicle.id!r})"
        holds = f"holds {vehicle.capacity}"
        return _Refusal(2, short, f"its demand of {demand}{with_first} is {nearest}", holds)
    overload = problem.fleet.overload(vehicle, stops)
    if overload is not None:
        reason = f"its load is {overload} (of {vehicle.id!r})"
        return _Refusal(2, -last.mass_kg, reason, f"would carry {overload}")
    clock = vehicle.ready_s
    for stop, driven_s in zip(stops, seconds, strict=True):
        arrival = clock + driven_s
        if stop is last and stop.latest_s is not None and arrival > stop.latest_s + _TOLERANCE_S:
            reason = f"{WINDOW_CLOSES} at {stop.latest_s:g} s, the first to arrive"
            reason += f" ({vehicle.id!r}) is there at {arrival:.0f} s"
            return _Refusal(3, -arrival, reason, f"there at {arrival:.0f} s")
        clock = max(arrival, stop.earliest_s) + stop.service_s
    back = clock + home_s
    if vehicle.return_by_s is not None and back > vehicle.return_by_s + _TOLERANCE_S:
        late = back - vehicle.return_by_s
        reason = f"who serves it is back too late ({vehicle.id!r} at {back:.0f} s,"
        reason += f" due at {vehicle.return_by_s:g} s)"
        return _Refusal(4, -late, reason, f"back {late:.0f} s too late")
    return _charge_refusal(problem, travel, vehicle, places)


def _by_whom(problem: RoutingProblem, vehicle: Vehicle) -> str:
    """Whose permissions and limits count, where the network has any."""
    if not problem.network.is_restricted:
        return ""
    vehicle_class = problem.profile_of(vehicle).vehicle_class
    return f" by roads that {vehicle.id!r} ({vehicle_class}) may use"


def _charge_refusal(
    problem: RoutingProblem, travel: Travel, vehicle: Vehicle, places: Sequence[str]
) -> _Refusal | None:
    """Why a vehicle's battery does not last from its depot over some places and back."""
    battery = battery_of(problem.fleet, vehicle)
    if battery is None:
        return None
    legs = [travel.leg(a, b) for a, b in pairwise([*places, places[0]])]
    found = [leg for leg in legs if leg is not None]
    if len(found) < len(legs):
        return None
    physics = problem.profile_of(vehicle).physics
    latest_s = vehicle.ready_s if vehicle.depart_by_s is None else vehicle.depart_by_s
    charge_kwh = battery.at_departure_kwh(latest_s)

    def energy_kwh(leg: RoadLeg) -> float:
        return leg_energy_kwh(leg, physics)

    lasts = with_charging_stops(battery, problem.fleet, travel, found, charge_kwh, energy_kwh)
    if lasts is not None:
        return None
    need_kwh, usable_kwh = sum(map(energy_kwh, found)), charge_kwh - battery.reserve_kwh
    reason = f"{need_kwh:.2f} kWh are needed there and back, and the most charge above its reserve"
    reason += f" ({vehicle.id!r}) is {max(0.0, usable_kwh):.2f} kWh, with no charging stop in reach"
    return _Refusal(5, usable_kwh - need_kwh, reason, "its battery does not last")
