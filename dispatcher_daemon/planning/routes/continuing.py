"""Legs and order of stops of vehicles that are bound to something; see `Commitment`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, permutations
from typing import Final

from dispatcher_daemon.fleet import Commitment, Vehicle
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import (
    RoadLeg,
    Roads,
    Route,
    Travel,
    leg_from,
    leg_onward,
    unhindered_s,
)

MAX_REORDERED: Final = 5
"""Stops whose order is tried in all ways, 120; of more, the order that the search gave them stays:
it knew all the fleet."""


def departure_s(own: Commitment, roads: Roads, now_ns: int) -> float:
    """When the committed part of a route begins, s after the cycle's start."""
    if own.moving is None:
        return 1e-9 * (own.departs_ns - now_ns)
    measured_s = 1e-9 * (own.moving.time_ns - now_ns)
    return measured_s - unhindered_s(roads, own.legs[0].path[0], own.moving.share)


def planned_waits_s(
    problem: RoutingProblem, own: Commitment, route: Route, now_ns: int, reference_s: float
) -> tuple[float, ...]:
    """Waits at the ends of a route's legs but the last by which a vehicle leaves its stops no
    sooner than its present plan says, where that has waits; shorter ones if it is late.

    Args:
        route: over its stops, without waits.
    """
    planned = {stop.stop: stop for stop in own.plan.stops if stop.wait_s > 0}
    waits, shift_s = list[float](), 0.0
    for visit in route.visits[1:-1]:
        served = problem.fleet.stop_by_id.get(visit.place)
        if served is not None:
            # What it has to wait for the window takes up what it waited before.
            early_s = reference_s + served.earliest_s - visit.arrival_s
            shift_s = max(0.0, shift_s - max(0.0, early_s))
        stop, wait_s = planned.get(visit.place), 0.0
        if stop is not None:
            leaves_s = 1e-9 * (stop.departure_ns - now_ns)
            wait_s = min(stop.wait_s, max(0.0, leaves_s - visit.departure_s - shift_s))
        waits.append(wait_s)
        shift_s += wait_s
    return tuple(waits)


def committed_legs(
    problem: RoutingProblem, travel: Travel, own: Commitment, vehicle: Vehicle
) -> list[RoadLeg] | None:
    """Its first legs, of which something is fixed; None: no way leads on."""
    fleet, roads, style = problem.fleet, travel.roads, problem.style
    depot = fleet.depot_of(vehicle)
    places = [(own.place, own.node), *((s, fleet.node(s)) for s in own.stops)]
    places.append((depot.id, depot.node))
    legs = []
    for number, (fixed, (start, end)) in enumerate(zip(own.legs, pairwise(places), strict=False)):
        leg = leg_onward(travel, fixed.path, start, end, style, complete=fixed.complete)
        if leg is None:
            return None
        if number == 0 and own.moving is not None:
            leg = leg_from(roads, leg, own.moving.share, own.moving.speed_mps, style)
        legs.append(leg)
    return legs


def best_order(
    problem: RoutingProblem,
    travel: Travel,
    own: Commitment,
    vehicle: Vehicle,
    begins_s: float,
    reference_s: float,
) -> tuple[str, ...]:
    """Its stops with those behind the fixed ones in the order of least lateness, then cost."""
    fixed, rest = own.fixed_stops, own.stops[len(own.fixed_stops) :]
    if not 1 < len(rest) <= MAX_REORDERED:
        return own.stops
    legs = committed_legs(problem, travel, own, vehicle)
    if legs is None:
        return own.stops
    fleet = problem.fleet
    depot = fleet.depot_of(vehicle).id

    def judged(order: Sequence[str]) -> tuple[float, float]:
        late_s, cost_kwh, clock = 0.0, 0.0, begins_s
        places = [own.place, *fixed, *order, depot]
        for number, (start, end) in enumerate(pairwise(places)):
            if number < len(legs):
                clock += legs[number].drive.duration_s
            else:
                i, j = travel.row[start], travel.row[end]
                clock += float(travel.duration_s[i, j])
                cost_kwh += float(travel.search_cost_kwh[i, j])
            stop = fleet.stop_by_id.get(end)
            if stop is not None:
                if stop.latest_s is not None:
                    late_s += max(0.0, clock - reference_s - stop.latest_s)
                clock = max(clock, reference_s + stop.earliest_s) + stop.service_s
        # Less than a second is within what durations are known to.
        return round(late_s), cost_kwh

    return (*fixed, *min(permutations(rest), key=judged))
