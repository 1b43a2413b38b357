"""Drag reductions of a fleet's vehicles at the gaps that its plans count on."""

from __future__ import annotations

from dispatcher_daemon.forms import RoutingProblem
from slipstream.energy.drafting import DragReductions, reductions_at
from slipstream.spacing import planned_gap_m
from slipstream.vehicle_types import RoutingProfile


def planned_reductions(
    problem: RoutingProblem, profile: RoutingProfile, speed_mps: float
) -> DragReductions:
    """η_drag by place of a vehicle whose platoon drives at a speed, by the law of its type."""
    gap_m = planned_gap_m(speed_mps, problem.advised_gap_m, profile.braking)
    return reductions_at(profile.drafting, gap_m)
