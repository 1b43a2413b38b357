"""From a selection of arcs to routes, or to the rules that it breaks.

This knows nothing of penalties, QUBOs or MILPs: it follows each vehicle from the depot and looks.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from dispatcher_daemon.problem import ArcProblem


@dataclass(frozen=True)
class Decoded:
    """Routes by vehicle (stops in order, without the depot), or what is wrong."""

    routes: dict[str, tuple[str, ...]] | None
    violations: tuple[str, ...]


def decode(problem: ArcProblem, selected: Collection[int]) -> Decoded:
    """Read routes from the selected arcs (indices into ``problem.arcs``).

    Valid means: every vehicle drives exactly one closed tour from the depot over at least one stop,
    every stop is on exactly one tour, once, and no selected arc is left over.
    """
    violations: list[str] = []
    routes: dict[str, tuple[str, ...]] = {}
    by_vehicle: dict[str, list[tuple[str, str]]] = {vehicle: [] for vehicle in problem.vehicles}
    for index in sorted(selected):
        arc = problem.arcs[index]
        by_vehicle[arc.vehicle].append((arc.start, arc.end))
    for vehicle, arcs in by_vehicle.items():
        stops, fault = _follow(problem.depot, arcs)
        if fault is not None:
            violations.append(f"{vehicle}: {fault}")
        else:
            routes[vehicle] = stops
    visits = [stop for stops in routes.values() for stop in stops]
    if not violations:
        violations += [
            f"{stop}: served {visits.count(stop)} times"
            for stop in problem.customers
            if visits.count(stop) != 1
        ]
    return Decoded(None, tuple(violations)) if violations else Decoded(routes, ())


def _follow(depot: str, arcs: list[tuple[str, str]]) -> tuple[tuple[str, ...], str | None]:
    after: dict[str, str] = {}
    for start, end in arcs:
        if start in after:
            return (), f"leaves {start} more than once"
        after[start] = end
    if depot not in after:
        return (), f"does not leave {depot}"
    stops: list[str] = []
    place = after.pop(depot)
    while place != depot:
        stops.append(place)
        if place not in after:
            return (), f"stays at {place}"
        place = after.pop(place)
    if after:
        return (), f"drives {sorted(after.items())} apart from its tour"
    return tuple(stops), None
