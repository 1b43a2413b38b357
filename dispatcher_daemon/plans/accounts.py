"""What each vehicle of a cycle does by the plan, alone, and in the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dispatcher_daemon.plans.candidates import Candidate
from dispatcher_daemon.plans.energy import RouteEnergy
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Route


@dataclass(frozen=True)
class VehicleAccount:
    """One vehicle in one cycle. Energies and times are 0 where it does not drive.

    Attributes:
        stops: that it serves, in order.
        driven_kwh: by the plan, with what its platoons are expected to save.
        alone_kwh: of the same drive with nobody near.
        driving_s: time on the road by the plan.
        waiting_s: for other vehicles, at stops and hubs; and at its depot, beyond the time at which
            it leaves in the baseline.
        platooned_m: way on which it is expected to be in a close platoon.
        baseline_stops: that it serves in the baseline, the plan without platooning.
        baseline_kwh: likewise.
        baseline_driving_s: likewise.
    """

    vehicle: str
    stops: tuple[str, ...]
    driven_kwh: float
    alone_kwh: float
    driving_s: float
    waiting_s: float
    platooned_m: float
    baseline_stops: tuple[str, ...]
    baseline_kwh: float
    baseline_driving_s: float


def vehicle_accounts(
    problem: RoutingProblem, chosen: Candidate, baseline: Candidate
) -> tuple[VehicleAccount, ...]:
    """Accounts of all vehicles of a fleet, in its order."""
    ours, theirs = _by_vehicle(chosen), _by_vehicle(baseline)
    return tuple(
        _account(problem, vehicle.id, ours.get(vehicle.id), theirs.get(vehicle.id))
        for vehicle in problem.fleet.vehicles
    )


def _by_vehicle(plan: Candidate) -> dict[str, tuple[Route, RouteEnergy]]:
    both = zip(plan.routes, plan.energies, strict=True)
    return {route.vehicle: (route, energy) for route, energy in both}


def _account(
    problem: RoutingProblem,
    vehicle: str,
    own: tuple[Route, RouteEnergy] | None,
    base: tuple[Route, RouteEnergy] | None,
) -> VehicleAccount:
    stops: tuple[str, ...] = ()
    kwh = alone_kwh = driving_s = platooned_m = waiting_s = 0.0
    if own is not None:
        route, energy = own
        stops = _stops(problem, route)
        kwh, alone_kwh = energy.driven.total_kwh, energy.undrafted.total_kwh
        driving_s, platooned_m = energy.driving_s, energy.platooned_m
        waiting_s = sum(visit.wait_s for visit in route.visits[1:])
        if base is not None:
            leaves_s = base[0].visits[0].departure_s
            waiting_s += max(0.0, route.visits[0].departure_s - leaves_s)
    return VehicleAccount(
        vehicle,
        stops,
        kwh,
        alone_kwh,
        driving_s,
        waiting_s,
        platooned_m,
        () if base is None else _stops(problem, base[0]),
        0.0 if base is None else base[1].undrafted.total_kwh,
        0.0 if base is None else base[1].driving_s,
    )


def _stops(problem: RoutingProblem, route: Route) -> tuple[str, ...]:
    visits: Sequence[str] = [visit.place for visit in route.visits[1:-1]]
    return tuple(place for place in visits if place in problem.fleet.stop_by_id)
