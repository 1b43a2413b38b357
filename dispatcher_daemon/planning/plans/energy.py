"""E_physical of plans, and savings split by cause (paper section II-C)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dispatcher_daemon.fleet import Passage
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning import Place, drag_reductions
from dispatcher_daemon.planning.roads import RoadLeg, Route
from dispatcher_daemon.planning.roads.charge import battery_of, charges_kwh, leg_energy_kwh
from slipstream.energy.consumption import (
    ETA_ALONE,
    Energy,
    drive_energies,
    segment_energies,
    split_saving,
    total,
)
from slipstream.messages import EnergySummary


@dataclass(frozen=True)
class RouteEnergy:
    """Energy of one route.

    Attributes:
        driven: with the drag reductions that are expected of its platoons.
        undrafted: the same drive without any.
        platooned_m: distance on which it is expected to drive in a close platoon.
        driving_s: time on the road, without stands at stops.
        driven_kwh: on each segment, with the drag reductions.
        undrafted_kwh: likewise without.
    """

    driven: Energy
    undrafted: Energy
    platooned_m: float
    driving_s: float
    driven_kwh: tuple[float, ...]
    undrafted_kwh: tuple[float, ...]


def route_energy(
    problem: RoutingProblem, route: Route, places: Mapping[Passage, Place]
) -> RouteEnergy:
    """Energy of a route from its speed profile; standing at stops needs none.

    Expected energy of a leg beyond that of its profile counts as acceleration: traffic and signals
    cause it. On the leg's segments it is spread by their lengths.
    """
    reductions = drag_reductions(problem, route, places)
    none = [[ETA_ALONE] * len(reduction) for reduction in reductions]
    drives = [leg.drive for leg in route.legs]
    physics = problem.profile_of(route.vehicle).physics
    by_segment = segment_energies(drives, reductions, physics)
    alone_by_segment = segment_energies(drives, none, physics)
    driven = drive_energies(drives, reductions, physics).sum()
    undrafted = drive_energies(drives, none, physics).sum()
    beyond = sum(leg.beyond_kwh for leg in route.legs)
    driven, undrafted = (
        e._replace(total_kwh=e.total_kwh + beyond, acceleration_kwh=e.acceleration_kwh + beyond)
        for e in (driven, undrafted)
    )
    platooned_m = sum(
        problem.network.segments[segment].length_m * place.share
        for number, position, segment, _, _ in route.entries_s()
        if (place := places.get((route.vehicle, number, position))) is not None
    )
    spread = [kwh for leg in route.legs for kwh in _spread_beyond(problem, leg)]
    return RouteEnergy(
        driven,
        undrafted,
        platooned_m,
        sum(d.duration_s for d in drives),
        tuple((by_segment.total_kwh + spread).tolist()),
        tuple((alone_by_segment.total_kwh + spread).tolist()),
    )


def _spread_beyond(problem: RoutingProblem, leg: RoadLeg) -> list[float]:
    lengths_m = [problem.network.segments[segment].length_m for segment in leg.path]
    whole_m = sum(lengths_m)
    return [leg.beyond_kwh * length_m / whole_m for length_m in lengths_m]


def planned_charges_kwh(
    problem: RoutingProblem, route: Route, reference_s: float
) -> Sequence[float | None]:
    """Charge at the departure and on arrival at each further place, as if nobody drafted; None
    where the vehicle's type has no battery.

    Args:
        reference_s: on the route's clock, the moment that the fleet's times count from.
    """
    battery = battery_of(problem.fleet, problem.fleet.vehicle_by_id[route.vehicle])
    if battery is None:
        return [None] * len(route.visits)
    physics = problem.profile_of(route.vehicle).physics
    energies_kwh = [leg_energy_kwh(leg, physics) for leg in route.legs]
    departure_kwh = battery.at_departure_kwh(route.visits[0].departure_s - reference_s)
    return [max(0.0, c) for c in charges_kwh(battery, route.legs, energies_kwh, departure_kwh)]


def summarise(
    name: str,
    baseline: Sequence[RouteEnergy],
    cooperative: Sequence[RouteEnergy],
    price_of_time_kw: float,
) -> EnergySummary:
    """Set a plan's energy against the baseline's, in which every vehicle drives alone.

    The saving is split as in `slipstream.energy.consumption.split_saving`; its parts add up.
    """
    base, ours = total(e.undrafted for e in baseline), total(e.undrafted for e in cooperative)
    driven = total(e.driven for e in cooperative)
    saving = split_saving(base, ours, driven)
    return EnergySummary(
        baseline=name,
        baseline_kwh=base.total_kwh,
        cooperative_kwh=driven.total_kwh,
        saved_distance_kwh=saving.distance_kwh,
        saved_drag_kwh=saving.drag_kwh,
        saved_acceleration_kwh=saving.acceleration_kwh,
        platooned_distance_m=sum(e.platooned_m for e in cooperative),
        baseline_driving_s=sum(e.driving_s for e in baseline),
        cooperative_driving_s=sum(e.driving_s for e in cooperative),
        price_of_time_kw=price_of_time_kw,
    )
