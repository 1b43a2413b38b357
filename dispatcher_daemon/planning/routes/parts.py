"""Cuts of a fleet and its stops, by carrier and location, into parts searched side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dispatcher_daemon.fleet import Fleet, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads.weights import Floats
from dispatcher_daemon.planning.routes.pyvrp_model import StopsByVehicle

_FULL_SHARE: Final = 0.99
"""Of the vehicles' capacity, from which on they are full."""


@dataclass(frozen=True)
class FleetPart:
    """Some vehicles, and the stops that only they may serve."""

    vehicles: Sequence[Vehicle]
    stops: Sequence[str]


def by_carrier(fleet: Fleet, stops: Sequence[str]) -> tuple[list[FleetPart], list[str]]:
    """(each carrier's vehicles and stops, if it has any; stops that are anybody's).

    Of a fleet of one carrier all stops are its own.
    """
    if len(fleet.carriers) == 1:
        return [FleetPart(fleet.vehicles, stops)], []
    loaded = {vehicle.first_stop: vehicle.carrier for vehicle in fleet.vehicles}
    own: dict[str | None, list[str]] = {carrier: [] for carrier in fleet.carriers}
    anybodys = []
    for name in stops:
        carrier = fleet.stop_by_id[name].carrier
        if name in loaded:
            own[loaded[name]].append(name)
        elif carrier is None:
            anybodys.append(name)
        else:
            own.setdefault(carrier, []).append(name)
    parts = [
        FleetPart([vehicle for vehicle in fleet.vehicles if vehicle.carrier == carrier], of_one)
        for carrier, of_one in own.items()
    ]
    return [part for part in parts if part.vehicles and part.stops], anybodys


def are_full(fleet: Fleet, stops: Sequence[str]) -> bool:
    """Whether the stops fill all vehicles; one unit too many is worth a detour then."""
    asked = set(stops)
    rooms = [v.capacity for v in fleet.vehicles if v.first_stop is None or v.first_stop in asked]
    limits = [room for room in rooms if room is not None]
    demand = sum(fleet.stop_by_id[stop].demand for stop in stops)
    return len(limits) == len(rooms) and demand > _FULL_SHARE * sum(limits)


def parts_of_routes(
    problem: RoutingProblem, whole: FleetPart, routes: StopsByVehicle, max_stops: int, number: int
) -> list[FleetPart]:
    """A part's routes cut at the median of where their stops lie, again and again, across a
    direction that turns from cut to cut and from round to round.

    Idle vehicles and unassigned stops are distributed over the parts.

    Args:
        max_stops: of the mean part.
    """
    at = _positions(problem)
    unassigned = unserved(whole.stops, routes)
    driving = [v for v in whole.vehicles if routes[v.id]]
    idle = [v for v in whole.vehicles if not routes[v.id]]
    centre = {v.id: np.mean([at[s] for s in routes[v.id]], axis=0) for v in driving}
    groups, angle = [driving], float(number)
    total = sum(len(routes[v.id]) for v in driving)
    while total > max_stops * len(groups):
        direction = np.array([np.cos(angle), np.sin(angle)])
        halves = []
        for group in groups:
            ordered = sorted(group, key=lambda v: (float(centre[v.id] @ direction), v.id))
            count = np.cumsum([len(routes[v.id]) for v in ordered])
            middle = int(np.searchsorted(count, count[-1] / 2)) + 1
            halves += [half for half in (ordered[:middle], ordered[middle:]) if half]
        if len(halves) == len(groups):
            break
        groups, angle = halves, angle + np.pi / 2
    return [
        FleetPart(
            [*group, *idle[i :: len(groups)]],
            [*(s for v in group for s in routes[v.id]), *unassigned[i :: len(groups)]],
        )
        for i, group in enumerate(groups)
    ]


def unserved(stops: Sequence[str], routes: StopsByVehicle) -> tuple[str, ...]:
    """Stops that are on no route."""
    served = {stop for of_one in routes.values() for stop in of_one}
    return tuple(stop for stop in stops if stop not in served)


def parts_of_stops(
    problem: RoutingProblem, whole: FleetPart, max_stops: int, seed: int
) -> list[FleetPart]:
    """A part's stops cut at the median of their demand across the longer side of where they lie,
    again and again, each half with the vehicles that begin nearest to it and have its share of the
    capacity.

    Vehicles are drawn at random where they begin at one place, as many of one type may be in a row.

    Args:
        max_stops: of the mean part.
    """
    fleet, at = problem.fleet, _positions(problem)
    stops, asked = whole.stops, set(whole.stops)
    vehicles = [v for v in whole.vehicles if v.first_stop is None or v.first_stop in asked]
    loaded = {v.first_stop for v in vehicles}
    begin = {v.id: at[v.first_stop or fleet.depot_of(v).id] for v in vehicles}
    limited = all(v.capacity is not None for v in vehicles)
    room = {v.id: float(v.capacity or 0) if limited else 1.0 for v in vehicles}
    demand = {s: 1e-6 + fleet.stop_by_id[s].demand for s in stops}
    drawn = np.random.default_rng(seed).permutation(len(vehicles))
    parts = [FleetPart([vehicles[i] for i in drawn], [s for s in stops if s not in loaded])]
    total = len(parts[0].stops)
    while total > max_stops * len(parts):
        halves = []
        for part in parts:
            if len(part.vehicles) < 2 or len(part.stops) < 2:
                halves.append(part)
                continue
            where = np.array([at[s] for s in part.stops])
            order = np.argsort(where[:, int(np.argmax(np.ptp(where, axis=0)))], kind="stable")
            ordered = [part.stops[i] for i in order]
            count = np.cumsum([demand[s] for s in ordered])
            middle = min(int(np.searchsorted(count, count[-1] / 2)) + 1, len(ordered) - 1)
            before, after = ordered[:middle], ordered[middle:]
            share = count[middle - 1] / count[-1]
            # Along the line between the centres, first who begins nearest to `before`.
            line = np.mean([at[s] for s in after], axis=0) - np.mean(
                [at[s] for s in before], axis=0
            )
            near = sorted(part.vehicles, key=lambda v: float(begin[v.id] @ line))
            count = np.cumsum([room[v.id] for v in near])
            middle = min(int(np.searchsorted(count, share * count[-1])) + 1, len(near) - 1)
            halves += [FleetPart(near[:middle], before), FleetPart(near[middle:], after)]
        if len(halves) == len(parts):
            break
        parts = halves
    firsts = [[v.first_stop for v in part.vehicles if v.first_stop] for part in parts]
    return [
        FleetPart(part.vehicles, [*own, *part.stops])
        for part, own in zip(parts, firsts, strict=True)
    ]


def _positions(problem: RoutingProblem) -> Mapping[str, Floats]:
    """Coordinates of depots and stops, m, shape (2,) each."""
    fleet, junctions = problem.fleet, problem.network.junctions
    places = [*(depot.id for depot in fleet.depots), *(stop.id for stop in fleet.stops)]
    return {name: np.array(junctions[fleet.node(name)], dtype=np.float64) for name in places}
