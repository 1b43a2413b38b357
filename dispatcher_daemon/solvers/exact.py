"""Exact answers: the linearised MILP with HiGHS."""

from __future__ import annotations

import time
from dataclasses import dataclass

from dispatcher_daemon.problem import Problem
from dispatcher_daemon.solvers.protocol import Outcome


@dataclass(frozen=True)
class ExactSolver:
    """HiGHS on the linearised MILP."""

    name: str = "exact"

    def warm_up(self) -> None:
        """Import HiGHS."""
        from dispatcher_daemon.formulations import milp  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        from dispatcher_daemon.formulations.milp import solve_milp

        began = time.perf_counter()
        # Leaves time to report what was found when time is up.
        result = solve_milp(problem, 0.8 * deadline_s, seed)
        return Outcome(
            solver=self.name,
            status=result.status,
            selected=result.selected,
            wall_s=time.perf_counter() - began,
            reason={
                "infeasible": "no valid route set exists",
                "timeout": "no answer within the deadline",
            }.get(result.status),
        )
