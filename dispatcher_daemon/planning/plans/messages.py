"""Timetables and platoons as messages to vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from dispatcher_daemon.fleet import Commitment, Passage
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.plans.energy import RouteEnergy, planned_charges_kwh
from dispatcher_daemon.planning.platooning import Place
from dispatcher_daemon.planning.roads import Route, planning_speed_mps
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.messages import (
    PlannedCrossing,
    PlannedSegment,
    PlannedStop,
    VehiclePlan,
)
from slipstream.roads import RoadNetwork

VALID_INTERVALS: Final = 2
BOUND_VALID_INTERVALS: Final = 4
"""A bound vehicle's plan goes out again only when it has changed, or would lapse."""


def vehicle_plans(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: DispatcherSettings,
    routes: Sequence[Route],
    places: Mapping[Passage, Place],
    energies: Sequence[RouteEnergy],
    *,
    cycle: int,
    issued_ns: int,
    reference_s: float,
    commitments: Sequence[Commitment],
) -> tuple[VehiclePlan, ...]:
    """One plan a route; its stops begin and end with the depot, leg n joins stops n and n + 1.

    It may be followed for `VALID_INTERVALS` cycles without a newer one, that of a bound vehicle for
    `BOUND_VALID_INTERVALS`.

    Args:
        issued_ns: UTC that the routes' times count from.
        reference_s: on the routes' clock, the moment that the fleet's times count from.
    """
    advice = settings.priced_advice
    bound = {own.vehicle: own for own in commitments}

    def utc_ns(seconds: float) -> int:
        return issued_ns + round(seconds * 1e9)

    network, stops = problem.network, problem.fleet.stop_by_id

    # Of what a vehicle has loaded a window that has closed stays the one that it was; in the
    # cycle's fleet it closes now.
    known = {
        (own.vehicle, stop.stop): stop.latest_ns
        for own in commitments
        for stop in own.plan.service_stops
    }

    def latest_ns(vehicle: str, place: str) -> int | None:
        stop = stops.get(place)
        if stop is None or stop.latest_s is None:
            return None
        before_ns = known.get((vehicle, place))
        return utc_ns(reference_s + stop.latest_s) if before_ns is None else before_ns

    def node(route: Route, number: int) -> str:
        if number == 0 and route.vehicle in bound:
            return bound[route.vehicle].node
        if number > 0 and route.legs[number - 1].pause is not None:
            return node(route, number - 1)
        return problem.fleet.node(route.visits[number].place)

    def segments(route: Route) -> tuple[PlannedSegment, ...]:
        planned = []
        profile = problem.profile_of(route.vehicle)
        for leg, position, segment, entry, leaving in route.entries_s():
            place = places.get((route.vehicle, leg, position))
            road = network.segments[segment]
            onward = route.legs[leg].path[position + 1 : position + 2]
            planned.append(
                PlannedSegment(
                    segment=segment,
                    entry_ns=utc_ns(entry),
                    exit_ns=utc_ns(leaving),
                    speed_mps=planning_speed_mps(road, snapshot.segments[segment], profile),
                    platoon=None if place is None else place.platoon,
                    place=None if place is None else place.number,
                    gap_m=settings.gap_m if place is not None and place.number > 0 else None,
                    drafting_share=None if place is None else place.share,
                    leg=leg,
                    length_m=road.length_m,
                    speed_limit_mps=road.access.speed_limit_mps(road.speed_limit_mps, profile),
                    lanes=road.lanes,
                    crossing=None if not onward else _crossing(network, segment, onward[0]),
                )
            )
        return tuple(planned)

    def visits(route: Route) -> tuple[PlannedStop, ...]:
        charges = planned_charges_kwh(problem, route, reference_s)
        taken = [0.0, *(leg.charging.energy_kwh if leg.charging else 0.0 for leg in route.legs)]
        breaks_s = [0.0, *(leg.pause.duration_s if leg.pause else 0.0 for leg in route.legs)]
        return tuple(
            PlannedStop(
                stop=visit.place,
                node=node(route, number),
                arrival_ns=utc_ns(visit.arrival_s),
                departure_ns=utc_ns(visit.departure_s),
                latest_ns=latest_ns(route.vehicle, visit.place),
                charge_kwh=charge_kwh,
                charged_kwh=charged_kwh,
                # All of a break's stay is one wait, so that older agents take it too.
                wait_s=visit.departure_s - visit.arrival_s if break_s > 0 else visit.wait_s,
                is_hub=break_s > 0 or visit.place in problem.fleet.hub_by_id,
                break_s=break_s,
            )
            for number, (visit, charge_kwh, charged_kwh, break_s) in enumerate(
                zip(route.visits, charges, taken, breaks_s, strict=True)
            )
        )

    def valid_s(route: Route) -> float:
        intervals = BOUND_VALID_INTERVALS if route.vehicle in bound else VALID_INTERVALS
        lasts_s = settings.interval_s * intervals
        hubs = problem.fleet.hub_by_id
        keeps = any(leg.charging or leg.pause or leg.end in hubs for leg in route.legs)
        # It is not planned again until it has charged, left its hub, or had its break.
        return lasts_s + route.visits[-1].arrival_s if keeps else lasts_s

    return tuple(
        VehiclePlan(
            vehicle=route.vehicle,
            cycle=cycle,
            issued_ns=issued_ns,
            valid_until_ns=utc_ns(valid_s(route)),
            continues=bound[route.vehicle].continues if route.vehicle in bound else None,
            depart_ns=utc_ns(route.visits[0].departure_s),
            stops=visits(route),
            segments=segments(route),
            distance_m=sum(leg.drive.length_m for leg in route.legs),
            energy_kwh=energy.driven.total_kwh,
            advice=advice,
        )
        for route, energy in zip(routes, energies, strict=True)
    )


def _crossing(network: RoadNetwork, segment: str, following: str) -> PlannedCrossing | None:
    """The junction between two segments; None where the network does not know it."""
    known = network.crossings.get((segment, following))
    if known is None:
        return None
    return PlannedCrossing(
        length_m=known.length_m,
        speed_mps=known.speed_mps,
        yields=known.yields,
        intersection=known.intersection,
        signal_groups=tuple(sorted(known.signal_groups.items())),
    )
