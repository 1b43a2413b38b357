"""Solvers behind one protocol, and the worker processes that they run in.

Names are loaded on demand: worker processes import this package too, and need few of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from slipstream.on_demand import on_demand

if TYPE_CHECKING:
    from dispatcher_daemon.solvers.cplex import CplexSolver
    from dispatcher_daemon.solvers.distribution import BitDistribution
    from dispatcher_daemon.solvers.exact import ExactSolver
    from dispatcher_daemon.solvers.heuristics import AnnealingSolver, TabuSolver
    from dispatcher_daemon.solvers.insertion import cheapest_insertion
    from dispatcher_daemon.solvers.protocol import (
        BackendKind,
        Execution,
        Histogram,
        Outcome,
        Samples,
        Solver,
        Status,
    )
    from dispatcher_daemon.solvers.registry import BASELINE_SOLVER, configured_solvers, make_solver
    from dispatcher_daemon.solvers.sampling import Bits, answer, descend, in_order, stages

__all__ = [
    "BASELINE_SOLVER",
    "AnnealingSolver",
    "BackendKind",
    "BitDistribution",
    "Bits",
    "CplexSolver",
    "ExactSolver",
    "Execution",
    "Histogram",
    "Outcome",
    "Samples",
    "Solver",
    "Status",
    "TabuSolver",
    "answer",
    "cheapest_insertion",
    "configured_solvers",
    "descend",
    "in_order",
    "make_solver",
    "stages",
]

# Light modules first; the registry imports all solvers.
__getattr__ = on_demand(
    __name__, __all__, "protocol distribution exact sampling registry insertion"
)
