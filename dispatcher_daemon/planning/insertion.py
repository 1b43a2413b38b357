"""Stops put into tours one by one, each where it costs least; all others stay where they are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.planning.itineraries import Itinerary, Planner
from dispatcher_daemon.plans import Candidate, Cycle, Refusal
from dispatcher_daemon.roads import fleet_travel

NAME: Final = "insertion"
NEAREST: Final = 6
"""Tours that a stop is tried in: those with the shortest detours in a straight line."""
MAX_STOPS: Final = 20
"""Stops that are put in at once: more of them are for a cycle."""


def insert_stops(
    cycle: Cycle, routes: Mapping[str, Sequence[str]], wanted: Sequence[str]
) -> tuple[Candidate | None, dict[str, str]]:
    """(verified plans of the vehicles whose tours have changed, if any have; why each of the other
    stops is in none).

    Args:
        cycle: its fleet has the vehicles of the tours, their stops, and those that are wanted.
        routes: stops in order by vehicle.
        wanted: stops that are on no route.
    """
    fleet = cycle.problem.fleet
    reason = "no tour that has not begun may take it, or has room and time for it"
    missing = dict.fromkeys(wanted, f"{reason}: it waits for the next cycle")
    for stop in wanted[MAX_STOPS:]:
        missing[stop] = f"more than {MAX_STOPS} came at once: it waits for the next cycle"
    wanted = wanted[:MAX_STOPS]
    near = {v for stop in wanted for v in _nearest(cycle, routes, stop)}
    part = _part(fleet, near, {*wanted, *(stop for v in near for stop in routes[v])})
    if not near:
        return None, missing
    problem = replace(cycle.problem, fleet=part)
    travel = fleet_travel(problem, cycle.snapshot)
    window_s = cycle.settings.sync_window_s
    planner = Planner(problem, cycle.snapshot, [travel], window_s, cycle.reference_s)
    present: dict[int, Itinerary] = {}
    for number, vehicle in enumerate(part.vehicles):
        stops = tuple(routes[vehicle.id])
        found = planner.idle(number)
        if stops:
            # A tour that has become late stays as it is.
            late = planner.itinerary(number, stops, planner.legs(number, stops))
            if late is None:
                continue
            found = late
        present[number] = found
    changed: dict[int, Itinerary] = {}
    for stop in wanted:
        better = cheapest_insertion(planner, list((present | changed).values()), stop)
        if better is not None:
            changed[better.number] = better
            del missing[stop]
    if not changed:
        return None, missing
    ordered = [changed[number] for number in sorted(changed)]
    names = {part.vehicles[number].id for number in changed}
    smaller = _part(part, names, {stop for itinerary in ordered for stop in itinerary.stops})
    cycle = replace(cycle, problem=replace(problem, fleet=smaller))
    timetables = [itinerary.route for itinerary in ordered if itinerary.route is not None]
    cost_kwh = math.fsum(itinerary.cost_kwh for itinerary in ordered)
    result = cycle.candidate(NAME, timetables, cost_kwh, platooning=False)
    if isinstance(result, Refusal):
        why = f"its plan was refused: {result.reason}"
        return None, missing | {s: why for i in ordered for s in i.stops if s in set(wanted)}
    return result, missing


def cheapest_insertion(
    planner: Planner, itineraries: Sequence[Itinerary], stop: str
) -> Itinerary | None:
    """The cheapest insertion of a stop into a route that has room, time and charge for it."""
    fleet = planner.problem.fleet
    best: tuple[float, Itinerary] | None = None
    for old in itineraries:
        vehicle = fleet.vehicles[old.number]
        if old.route is None and vehicle.first_stop is not None:
            continue
        if not fleet.may_serve(vehicle, fleet.stop_by_id[stop]):
            continue
        for at in range(0 if vehicle.first_stop is None else 1, len(old.stops) + 1):
            tried = (*old.stops[:at], stop, *old.stops[at:])
            if fleet.overload(vehicle, [fleet.stop_by_id[s] for s in tried]) is not None:
                break
            new = planner.itinerary(old.number, tried, planner.legs(old.number, tried))
            if new is not None and (best is None or new.cost_kwh - old.cost_kwh < best[0]):
                best = new.cost_kwh - old.cost_kwh, new
    return None if best is None else best[1]


def _nearest(cycle: Cycle, routes: Mapping[str, Sequence[str]], stop: str) -> list[str]:
    """The vehicles that may serve a stop, and carry it, with the shortest detours."""
    fleet, at = cycle.problem.fleet, cycle.problem.network.junctions
    there, wanted = at[fleet.node(stop)], fleet.stop_by_id[stop]
    found = []
    for vehicle in fleet.vehicles:
        served = [fleet.stop_by_id[s] for s in routes[vehicle.id]]
        if not fleet.may_serve(vehicle, wanted) or fleet.overload(vehicle, [*served, wanted]):
            continue
        home = fleet.depot_of(vehicle).node
        places = [at[node] for node in (home, *(s.node for s in served), home)]
        detours = (
            math.dist(a, there) + math.dist(there, b) - math.dist(a, b) for a, b in pairwise(places)
        )
        found.append((min(detours), vehicle.id))
    return [name for _, name in sorted(found)[:NEAREST]]


def _part(fleet: Fleet, vehicles: set[str], stops: set[str]) -> Fleet:
    kept = {
        "vehicles": tuple(v for v in fleet.vehicles if v.id in vehicles),
        "stops": tuple(stop for stop in fleet.stops if stop.id in stops),
    }
    return Fleet.model_construct(**fleet.parts | kept)
