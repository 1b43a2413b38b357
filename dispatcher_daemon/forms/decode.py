"""Decoding of selections of arcs or options to routes, or to the rules that they break.

It is independent of penalties, QUBOs and MILPs: it follows each vehicle's arcs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

from dispatcher_daemon.forms.problem import ArcProblem, BinaryProblem, Problem, RouteProblem


@dataclass(frozen=True)
class Decoded:
    """Routes by vehicle (stops in order, without the depot), or what is wrong."""

    routes: dict[str, tuple[str, ...]] | None
    violations: tuple[str, ...]


def decode(problem: Problem, selected: Collection[int]) -> Decoded:
    """Read routes from the selected arcs or options (indices into the problem's).

    Valid means in the arc form: every vehicle drives exactly one closed tour from the depot over at
    least one stop, and no selected arc is left over. In the route form: every vehicle has exactly
    one option. In both: every stop is served exactly once. A QUBO as such has no
    rules.
    """
    if isinstance(problem, BinaryProblem):
        return Decoded({}, ())
    if isinstance(problem, ArcProblem):
        routes, faults = _arc_routes(problem, selected)
        stops = problem.customers
    else:
        routes, faults = _option_routes(problem, selected)
        stops = problem.stops
    if not faults:
        visits = Counter(stop for served in routes.values() for stop in served)
        faults = [f"{stop}: served {visits[stop]} times" for stop in stops if visits[stop] != 1]
    return Decoded(None, tuple(faults)) if faults else Decoded(routes, ())


def violations(problem: Problem, selected: Collection[int]) -> tuple[str, ...]:
    """The rules that a selection breaks, in words; empty if it is valid."""
    return decode(problem, selected).violations


def _arc_routes(
    problem: ArcProblem, selected: Collection[int]
) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    faults: list[str] = []
    routes: dict[str, tuple[str, ...]] = {}
    by_vehicle: dict[str, list[tuple[str, str]]] = {vehicle: [] for vehicle in problem.vehicles}
    for index in sorted(selected):
        arc = problem.arcs[index]
        by_vehicle[arc.vehicle].append((arc.start, arc.end))
    for vehicle, arcs in by_vehicle.items():
        stops, fault = _follow(problem.depot, arcs)
        if fault is not None:
            faults.append(f"{vehicle}: {fault}")
        else:
            routes[vehicle] = stops
    return routes, faults


def _option_routes(
    problem: RouteProblem, selected: Collection[int]
) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    chosen: dict[str, list[tuple[str, ...]]] = {vehicle: [] for vehicle in problem.vehicles}
    for index in sorted(selected):
        chosen[problem.options[index].vehicle].append(problem.options[index].stops)
    faults = [
        f"{vehicle}: {len(options)} options selected"
        for vehicle, options in chosen.items()
        if len(options) != 1
    ]
    return {vehicle: options[0] for vehicle, options in chosen.items() if options}, faults


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
