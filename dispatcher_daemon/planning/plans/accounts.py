"""What each vehicle of a cycle does by the plan, alone, and in the baseline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import fsum

import networkx as nx

from dispatcher_daemon.fleet import Commitment
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.plans.candidates import Candidate
from dispatcher_daemon.planning.plans.energy import RouteEnergy
from dispatcher_daemon.planning.roads import Route
from slipstream.energy.consumption import Energy, split_saving, total
from slipstream.energy.ledger import PlanEnergy
from slipstream.explain import VehicleAccount


def vehicle_accounts(
    problem: RoutingProblem, chosen: Candidate, baseline: Candidate
) -> tuple[VehicleAccount, ...]:
    """Accounts of all vehicles of a fleet, in its order."""
    ours, theirs = _by_vehicle(chosen), _by_vehicle(baseline)
    return tuple(
        _account(problem, vehicle.id, ours.get(vehicle.id), theirs.get(vehicle.id))
        for vehicle in problem.fleet.vehicles
    )


def plan_energies(
    problem: RoutingProblem,
    chosen: Candidate,
    baseline: Candidate | None,
    commitments: Sequence[Commitment] = (),
) -> dict[str, PlanEnergy]:
    """What each plan needs on its way, and saves against its vehicle's part of the baseline.

    A vehicle that serves the same stops in both has its own baseline. Where vehicles serve stops of
    each other, their baselines together are parted by what their plans need without drafting. Over
    all vehicles the parts add up to the cycle's `EnergySummary`.

    Args:
        baseline: of the cycle; None: there is none, and each plan alone without drafting is it.
    """
    ours = _by_vehicle(chosen)
    begins = {own.vehicle: own.moving.share for own in commitments if own.moving is not None}
    bases = {vehicle: energy.undrafted for vehicle, (_, energy) in ours.items()}
    if baseline is not None:
        theirs = _by_vehicle(baseline)
        for group in _groups(problem, ours, theirs):
            whole = total(theirs[v][1].undrafted for v in group if v in theirs)
            needed_kwh = fsum(ours[v][1].undrafted.total_kwh for v in group if v in ours)
            for vehicle in group:
                if vehicle in ours and needed_kwh > 0:
                    share = ours[vehicle][1].undrafted.total_kwh / needed_kwh
                    bases[vehicle] = Energy(*(share * part for part in whole))
    found = {}
    for vehicle, (_, energy) in ours.items():
        saving = split_saving(bases[vehicle], energy.undrafted, energy.driven)
        pairs = zip(energy.undrafted_kwh, energy.driven_kwh, strict=True)
        found[vehicle] = PlanEnergy(
            driven_kwh=energy.driven_kwh,
            saved_drag_kwh=tuple(undrafted - driven for undrafted, driven in pairs),
            saved_distance_kwh=saving.distance_kwh,
            saved_acceleration_kwh=saving.acceleration_kwh,
            begin=begins.get(vehicle, 0.0),
        )
    return found


def _groups(
    problem: RoutingProblem,
    ours: Mapping[str, tuple[Route, RouteEnergy]],
    theirs: Mapping[str, tuple[Route, RouteEnergy]],
) -> Iterator[list[str]]:
    """Vehicles that serve stops of each other in one of two plans or the other."""
    graph = nx.Graph()
    for plan in (ours, theirs):
        for vehicle, (route, _) in plan.items():
            graph.add_node(("vehicle", vehicle))
            for stop in _stops(problem, route):
                graph.add_edge(("vehicle", vehicle), ("stop", stop))
    for group in nx.connected_components(graph):
        yield sorted(name for kind, name in group if kind == "vehicle")


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
