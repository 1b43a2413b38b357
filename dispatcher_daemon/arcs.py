"""From routed arcs and judged rewards to the paper's arc form."""

from __future__ import annotations

from collections.abc import Sequence

from dispatcher_daemon.fleet import DEPOT
from dispatcher_daemon.problem import ArcProblem, CandidateArc, RoutingProblem
from dispatcher_daemon.rewards import JudgedPair, judge_pairs, rewards
from dispatcher_daemon.routes import RoutedArc, candidate_arcs, least_energy_legs
from dispatcher_daemon.traffic import TrafficSnapshot


def arc_problem(
    problem: RoutingProblem, arcs: Sequence[RoutedArc], judged: Sequence[JudgedPair]
) -> ArcProblem:
    """The arc form of one cycle."""
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


def arc_problem_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    reference_s: float = 0.0,
) -> ArcProblem:
    """The arc form of a routing problem under given traffic.

    Args:
        sync_window_s: Δt_sync.
        reference_s: when a vehicle that is ready at once leaves.
    """
    arcs = candidate_arcs(problem, least_energy_legs(problem, snapshot), reference_s)
    return arc_problem(problem, arcs, tuple(judge_pairs(problem, arcs, snapshot, sync_window_s)))
