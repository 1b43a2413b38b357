"""Breaks of vehicles on their tours: at stops, between service and the way on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dispatcher_daemon.fleet import Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import RoadLeg, Route, empty_leg, lateness_s, timed


def with_breaks(
    problem: RoutingProblem, vehicle: Vehicle, legs: Sequence[RoadLeg], reference_s: float
) -> list[RoadLeg]:
    """The legs of a tour with the vehicle's breaks, each at the stop at which it makes the tour
    least late, then shortest, if it leaves as soon as it is ready. Those that the time at the depot
    takes are left out.

    Whether they are kept is for the finished route to say, as a later departure moves them.
    """
    found, first = list(legs), 1
    for number, own in enumerate(vehicle.breaks):
        route = timed(problem, found, vehicle, reference_s)
        leaves_s, back_s = (
            route.visits[0].departure_s - reference_s,
            route.visits[-1].arrival_s - reference_s,
        )
        if number in vehicle.breaks_at_depot(leaves_s, back_s):
            continue
        name, best = vehicle.break_id(number), None
        # At once after the break before only where no place behind it is better.
        places = (*range(first + 1, len(found)), first) if first > 1 else range(1, len(found))
        for at in places:
            place = found[at].start
            pause = replace(empty_leg(place, name), pause=own)
            tried = [*found[:at], pause, *found[at:]]
            route = timed(problem, tried, vehicle, reference_s)
            judged = _judged(problem, vehicle, route, reference_s)
            if best is None or judged < best[0]:
                best = judged, at, tried
        if best is not None:
            found, first = best[2], best[1] + 1
    return found


def _judged(
    problem: RoutingProblem, vehicle: Vehicle, route: Route, reference_s: float
) -> tuple[float, float]:
    late_s = max(0.0, lateness_s(problem, vehicle, route, reference_s))
    return late_s, route.visits[-1].arrival_s
