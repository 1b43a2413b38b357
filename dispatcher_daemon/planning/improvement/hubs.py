"""Hubs on a vehicle's way at which it may wait for others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from dispatcher_daemon.planning.roads import RoadLeg
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner

MAX_HUBS: Final = 2
"""Hubs of one route that are tried: those of the least detours."""


def over_hubs(planner: Planner, itinerary: Itinerary) -> Iterator[tuple[int, Itinerary]]:
    """(number of the visit, the route with a leg over a hub) where savings could pay for it."""
    fleet = planner.problem.fleet
    if itinerary.route is None or not fleet.hubs or not planner.problem.waits_on_tours:
        return
    legs, visits = itinerary.route.legs, itinerary.route.visits
    if any(leg.end in fleet.hub_by_id for leg in legs):
        return
    if (
        itinerary.number in planner.windows.bound
        and planner.batteries.of[itinerary.number] is not None
    ):
        return  # it goes on as it can: its charge is not looked at
    travel = planner.travels[0].of(fleet.vehicles[itinerary.number])
    fixed = len(planner.fixed_legs(itinerary.number) or ())
    found: list[tuple[float, int, RoadLeg, RoadLeg]] = []
    for at, leg in enumerate(legs[fixed:], fixed):
        if leg.pause is not None:
            continue
        gains_kwh = planner.book.followed_kwh(itinerary.traversals, visits[at].departure_s)
        for hub in fleet.hubs:
            there, on = travel.leg(leg.start, hub.id), travel.leg(hub.id, leg.end)
            if there is None or on is None or not there.path or not on.path:
                continue
            extra_kwh = there.cost_kwh + on.cost_kwh - leg.cost_kwh
            if extra_kwh < gains_kwh:
                found.append((extra_kwh, at, there, replace(on, charging=leg.charging)))
    for _, at, there, on in sorted(found, key=lambda entry: entry[:2])[:MAX_HUBS]:
        waits_s = itinerary.waits_s
        changed = planner.itinerary(
            itinerary.number,
            itinerary.stops,
            [*legs[:at], there, on, *legs[at + 1 :]],
            itinerary.depart_s,
            (*waits_s[:at], 0.0, *waits_s[at:]),
        )
        if changed is not None:
            yield at + 1, changed
