"""Candidate plans: physical energy, verification and messages."""

from __future__ import annotations

from dispatcher_daemon.planning.plans.accounts import plan_energies, vehicle_accounts
from dispatcher_daemon.planning.plans.candidates import (
    Candidate,
    CandidateRefusal,
    Cycle,
    DeclinedMeeting,
    FormResult,
    Gains,
)
from dispatcher_daemon.planning.plans.energy import RouteEnergy, route_energy, summarise
from dispatcher_daemon.planning.plans.reissue import plans_to_send
from dispatcher_daemon.planning.plans.solver_report import solver_report
from dispatcher_daemon.planning.plans.verify import verify_plans

__all__ = [
    "Candidate",
    "CandidateRefusal",
    "Cycle",
    "DeclinedMeeting",
    "FormResult",
    "Gains",
    "RouteEnergy",
    "plan_energies",
    "plans_to_send",
    "route_energy",
    "solver_report",
    "summarise",
    "vehicle_accounts",
    "verify_plans",
]
