"""Routing problems as models that solvers take: arc-form QUBO, linearised MILP."""

from __future__ import annotations

from dispatcher_daemon.forms.arc import (
    ArcVariable,
    OrderBit,
    PenaltyRow,
    SlackBit,
    Variable,
    build_arc_model,
    constraint_rows,
)
from dispatcher_daemon.forms.decode import decode, violations
from dispatcher_daemon.forms.enumerate import BLOCK_BITS, MAX_VARIABLES, energies_of
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import (
    ArcProblem,
    ArcReward,
    BinaryProblem,
    CandidateArc,
    Problem,
    RouteOption,
    RouteProblem,
    RoutingProblem,
    routing_problem,
)
from dispatcher_daemon.forms.qubo import Encoding, QuboModel

__all__ = [
    "BLOCK_BITS",
    "MAX_VARIABLES",
    "ArcProblem",
    "ArcReward",
    "ArcVariable",
    "BinaryProblem",
    "CandidateArc",
    "Encoding",
    "OrderBit",
    "PenaltyRow",
    "Problem",
    "QuboModel",
    "RouteOption",
    "RouteProblem",
    "RoutingProblem",
    "SlackBit",
    "Variable",
    "build_arc_model",
    "build_model",
    "constraint_rows",
    "decode",
    "energies_of",
    "routing_problem",
    "violations",
]
