"""Parts of a fleet that are searched for routes one by one: by carrier and by location."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dispatcher_daemon.fleet import Fleet, Vehicle
from dispatcher_daemon.planning.pyvrp_model import StopsByVehicle
from dispatcher_daemon.problem import RoutingProblem


@dataclass(frozen=True)
class Group:
    """Vehicles, and stops for them alone."""

    vehicles: Sequence[Vehicle]
    stops: Sequence[str]


def by_carrier(fleet: Fleet, stops: Sequence[str]) -> tuple[list[Group], list[str]]:
    """(each carrier's vehicles and stops, if it has any; stops that are anybody's).

    Of a fleet of one carrier all stops are its own.
    """
    if len(fleet.carriers) == 1:
        return [Group(fleet.vehicles, stops)], []
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
    groups = [
        Group([vehicle for vehicle in fleet.vehicles if vehicle.carrier == carrier], of_one)
        for carrier, of_one in own.items()
    ]
    return [group for group in groups if group.vehicles and group.stops], anybodys


def parts_of(
    problem: RoutingProblem,
    vehicles: Sequence[Vehicle],
    routes: StopsByVehicle,
    unassigned: Sequence[str],
    part_stops: int,
    number: int,
) -> list[tuple[list[Vehicle], list[str]]]:
    """(vehicles, stops) of each part: routes cut at the median of where their stops lie, again
    and again, across a direction that turns from cut to cut and from round to round.

    Idle vehicles and unassigned stops are distributed over the parts.
    """
    fleet, junctions = problem.fleet, problem.network.junctions
    driving = [v for v in vehicles if routes[v.id]]
    idle = [v for v in vehicles if not routes[v.id]]
    centre = {
        v.id: np.mean([junctions[fleet.node(s)] for s in routes[v.id]], axis=0) for v in driving
    }
    groups, angle = [driving], float(number)
    total = sum(len(routes[v.id]) for v in driving)
    while total > part_stops * len(groups):
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
        (
            [*group, *idle[i :: len(groups)]],
            [*(s for v in group for s in routes[v.id]), *unassigned[i :: len(groups)]],
        )
        for i, group in enumerate(groups)
    ]
