"""Timetables and platoons as messages to vehicles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dispatcher_daemon.plans.energy import RouteEnergy, planned_charges_kwh
from dispatcher_daemon.platooning import Passage, Place
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Route, planning_speed_mps
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.messages import (
    DrivingAdvice,
    PlannedCrossing,
    PlannedSegment,
    PlannedStop,
    VehiclePlan,
)
from slipstream.roads import RoadNetwork


def vehicle_plans(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    routes: Sequence[Route],
    places: Mapping[Passage, Place],
    energies: Sequence[RouteEnergy],
    *,
    cycle: int,
    issued_ns: int,
    reference_s: float,
    valid_s: float,
    gap_m: float,
    advice: DrivingAdvice,
) -> tuple[VehiclePlan, ...]:
    """One plan a route; its stops begin and end with the depot, leg n joins stops n and n + 1.

    Args:
        issued_ns: UTC that the routes' times count from.
        reference_s: on the routes' clock, the moment that the fleet's times count from.
        valid_s: how long the plan may be followed without a newer one.
        gap_m: gap advised to followers, m.
        advice: given to every vehicle.
    """

    def utc_ns(seconds: float) -> int:
        return issued_ns + round(seconds * 1e9)

    network, stops = problem.network, problem.fleet.stop_by_id

    def latest_ns(place: str) -> int | None:
        stop = stops.get(place)
        return (
            None if stop is None or stop.latest_s is None else utc_ns(reference_s + stop.latest_s)
        )

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
                    speed_mps=planning_speed_mps(snapshot.segments[segment], profile),
                    platoon=None if place is None else place.platoon,
                    place=None if place is None else place.number,
                    gap_m=gap_m if place is not None and place.number > 0 else None,
                    leg=leg,
                    length_m=road.length_m,
                    speed_limit_mps=road.speed_limit_mps,
                    lanes=road.lanes,
                    crossing=None if not onward else _crossing(network, segment, onward[0]),
                )
            )
        return tuple(planned)

    def visits(route: Route) -> tuple[PlannedStop, ...]:
        charges = planned_charges_kwh(problem, route, reference_s)
        taken = [0.0, *(leg.charging.energy_kwh if leg.charging else 0.0 for leg in route.legs)]
        return tuple(
            PlannedStop(
                stop=visit.place,
                node=problem.fleet.node(visit.place),
                arrival_ns=utc_ns(visit.arrival_s),
                departure_ns=utc_ns(visit.departure_s),
                latest_ns=latest_ns(visit.place),
                charge_kwh=charge_kwh,
                charged_kwh=charged_kwh,
            )
            for visit, charge_kwh, charged_kwh in zip(route.visits, charges, taken, strict=True)
        )

    return tuple(
        VehiclePlan(
            vehicle=route.vehicle,
            cycle=cycle,
            issued_ns=issued_ns,
            valid_until_ns=utc_ns(valid_s),
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
