"""The two parts of a cycle's fleet: vehicles that are free, and those bound to something."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from dispatcher_daemon.fleet import Commitment, Fleet
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.roads import Travel
from dispatcher_daemon.planning.routes.continuing import best_order, committed_legs, departure_s
from dispatcher_daemon.planning.routes.pyvrp_model import StopsByVehicle


def unbound(cycle: Cycle) -> RoutingProblem | None:
    """The problem of free vehicles and stops on no vehicle; None: one of the two is missing."""
    if not cycle.commitments:
        return cycle.problem
    fleet = cycle.problem.fleet
    bound = {own.vehicle for own in cycle.commitments}
    loaded = {stop for own in cycle.commitments for stop in own.stops}
    vehicles = tuple(vehicle for vehicle in fleet.vehicles if vehicle.id not in bound)
    stops = tuple(stop for stop in fleet.stops if stop.id not in loaded)
    if not vehicles or not stops:
        return None
    smaller = Fleet(**fleet.parts | {"stops": stops, "vehicles": vehicles})
    return replace(cycle.problem, fleet=smaller)


def bound_routes(cycle: Cycle, travel: Travel) -> StopsByVehicle:
    """Stops in order of the bound vehicles, and none of a free one."""
    by_vehicle = {own.vehicle: own for own in cycle.commitments}
    found: StopsByVehicle = {}
    for vehicle in cycle.problem.fleet.vehicles:
        own = by_vehicle.get(vehicle.id)
        if own is None:
            found[vehicle.id] = ()
            continue
        of = travel.of(vehicle)
        begins_s = departure_s(own, of.roads, cycle.now_ns)
        found[vehicle.id] = best_order(cycle.problem, of, own, vehicle, begins_s, cycle.reference_s)
    return found


def drivable(cycle: Cycle, travel: Travel) -> Cycle:
    """The cycle without the bound vehicles that some leg has no way for, and their stops."""
    lost = [own for own in cycle.commitments if not _leads_home(cycle, travel, own)]
    if not lost:
        return cycle
    vehicles = {own.vehicle for own in lost}
    stops = {stop for own in lost for stop in own.stops}
    fleet = cycle.problem.fleet
    left = {
        "stops": tuple(stop for stop in fleet.stops if stop.id not in stops),
        "vehicles": tuple(vehicle for vehicle in fleet.vehicles if vehicle.id not in vehicles),
    }
    smaller = Fleet.model_construct(**fleet.parts | left)
    return replace(
        cycle,
        problem=replace(cycle.problem, fleet=smaller),
        commitments=tuple(own for own in cycle.commitments if own.vehicle not in vehicles),
    )


def _leads_home(cycle: Cycle, travel: Travel, own: Commitment) -> bool:
    fleet = cycle.problem.fleet
    vehicle = next(v for v in fleet.vehicles if v.id == own.vehicle)
    travel = travel.of(vehicle)
    legs = committed_legs(cycle.problem, travel, own, vehicle)
    if legs is None:
        return False
    places = [*own.stops, fleet.depot_of(vehicle).id]
    rest = list(pairwise(places))[max(0, len(legs) - 1) :]
    return all(travel.leg(*pair) is not None for pair in rest)
