"""E_physical of plans and the honest split of what was saved (paper section II-C)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dispatcher_daemon.drive import drive_energy
from dispatcher_daemon.platoons import Passage, Place, drag_reductions
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.routes import Route
from slipstream.energy import Energy
from slipstream.messages import EnergySummary


@dataclass(frozen=True)
class RouteEnergy:
    """Energy of one route.

    Attributes:
        driven: with the drag reductions of its platoons.
        alone: the same drive without any.
        platooned_m: distance driven in a platoon, as leader or follower.
    """

    driven: Energy
    alone: Energy
    platooned_m: float


def route_energy(
    problem: RoutingProblem, route: Route, places: Mapping[Passage, Place]
) -> RouteEnergy:
    """Energy of a route from its speed trace; standing at stops needs none."""
    reductions = drag_reductions(route, places)
    driven, alone = [], []
    for leg, reduction in zip(route.legs, reductions, strict=True):
        driven.append(drive_energy(leg.drive, reduction, problem.vehicle))
        alone.append(drive_energy(leg.drive, [0.0] * len(reduction), problem.vehicle))
    platooned_m = sum(
        problem.network.segments[segment].length_m
        for number, position, segment, _, _ in route.entries_s()
        if (route.vehicle, number, position) in places
    )
    return RouteEnergy(_total(driven), _total(alone), platooned_m)


def summarise(
    name: str, baseline: Sequence[RouteEnergy], cooperative: Sequence[RouteEnergy]
) -> EnergySummary:
    """Set a plan's energy against the baseline's, in which every vehicle drives alone.

    The parts add up to the whole saving:

    - drag: what drafting saves on the cooperative routes, same drive with and without it;
    - acceleration: the difference between the undrafted routes in energy for speed changes;
    - distance: their difference in rolling resistance and (undrafted) drag, that is, in how far
      and at what speeds they drive.
    """
    base, ours = _total([e.alone for e in baseline]), _total([e.alone for e in cooperative])
    driven = _total([e.driven for e in cooperative])
    return EnergySummary(
        baseline=name,
        baseline_kwh=base.total_kwh,
        cooperative_kwh=driven.total_kwh,
        saved_distance_kwh=(base.rolling_kwh + base.drag_kwh) - (ours.rolling_kwh + ours.drag_kwh),
        saved_drag_kwh=ours.total_kwh - driven.total_kwh,
        saved_acceleration_kwh=base.acceleration_kwh - ours.acceleration_kwh,
        platooned_distance_m=sum(e.platooned_m for e in cooperative),
    )


def _total(parts: Sequence[Energy]) -> Energy:
    return Energy(*(sum(values) for values in zip(*parts, strict=True)))
