"""From routed arcs and judged rewards to the paper's arc form."""

from __future__ import annotations

from collections.abc import Sequence

from dispatcher_daemon.fleet import DEPOT
from dispatcher_daemon.forms import ArcProblem, CandidateArc, RoutingProblem
from dispatcher_daemon.planning.platooning import JudgedPair, judge_pairs, rewards
from dispatcher_daemon.planning.roads import RoadLeg, RoutedArc, candidate_arcs, least_energy_legs
from dispatcher_daemon.traffic import TrafficSnapshot


def arc_parts(
    problem: RoutingProblem, snapshot: TrafficSnapshot, sync_window_s: float, reference_s: float
) -> tuple[
    dict[tuple[str, str], RoadLeg], tuple[RoutedArc, ...], tuple[JudgedPair, ...], ArcProblem
]:
    """(least-energy paths by (from, to), candidate arcs, judged pairs, what solvers get)."""
    legs = least_energy_legs(problem, snapshot)
    arcs = candidate_arcs(problem, legs, reference_s)
    judged = tuple(judge_pairs(problem, arcs, snapshot, sync_window_s))
    return legs, arcs, judged, arc_problem(problem, arcs, judged)


def arc_problem_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    reference_s: float = 0.0,
) -> ArcProblem:
    """The arc form of a routing problem under given traffic."""
    return arc_parts(problem, snapshot, sync_window_s, reference_s)[-1]


def arc_problem(
    problem: RoutingProblem, arcs: Sequence[RoutedArc], judged: Sequence[JudgedPair]
) -> ArcProblem:
    """The arc form of routed arcs and their judged rewards."""
    depots = problem.fleet.depot_by_id

    def place(name: str) -> str:
        return DEPOT if name in depots else name

    return ArcProblem(
        depot=DEPOT,
        customers=tuple(stop.id for stop in problem.fleet.stops),
        vehicles=tuple(vehicle.id for vehicle in problem.fleet.vehicles),
        arcs=tuple(
            CandidateArc(a.vehicle, place(a.leg.start), place(a.leg.end), a.leg.cost_kwh)
            for a in arcs
        ),
        rewards=rewards(judged),
    )
