"""From routed arcs and judged rewards to the paper's arc form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dispatcher_daemon.fleet import DEPOT
from dispatcher_daemon.forms import ArcProblem, CandidateArc, RoutingProblem
from dispatcher_daemon.planning.platooning import JudgedPair, judge_pairs, rewards
from dispatcher_daemon.planning.roads import RoadLeg, RoutedArc, candidate_arcs, least_energy_legs
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


@dataclass(frozen=True)
class ArcParts:
    """The arc form of a routing problem under given traffic, with its legs, arcs and rewards.

    Attributes:
        legs: least-energy paths by (from, to).
        arcs: the candidate arcs.
        judged: every pair of arcs that share a watched segment, and why it platoons or not.
        problem: what solvers get.
    """

    legs: Mapping[tuple[str, str], RoadLeg]
    arcs: tuple[RoutedArc, ...]
    judged: tuple[JudgedPair, ...]
    problem: ArcProblem


def arc_parts_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    reference_s: float = 0.0,
) -> ArcParts:
    """Build the arc form.

    Args:
        sync_window_s: Δt_sync.
        reference_s: when a vehicle that is ready at once leaves.
    """
    legs = least_energy_legs(problem, snapshot)
    arcs = candidate_arcs(problem, legs, reference_s)
    judged = tuple(judge_pairs(problem, arcs, snapshot, sync_window_s))
    return ArcParts(legs, arcs, judged, arc_problem(problem, arcs, judged))


def arc_problem_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    reference_s: float = 0.0,
) -> ArcProblem:
    """The problem of `arc_parts_of` alone."""
    return arc_parts_of(problem, snapshot, sync_window_s, reference_s).problem
