"""Exact answers: the linearised MILP with HiGHS; small QUBOs without constraints by enumeration."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from dispatcher_daemon.forms import BinaryProblem, Problem
from dispatcher_daemon.solvers.protocol import Outcome

_ENUMERATED: Final = 22
"""Variables of a QUBO whose states are all looked at: 0.1 s. HiGHS has no constraints to cut by
there, and takes longer than 8 s for a dense one of 20.
"""


@dataclass(frozen=True)
class ExactSolver:
    """HiGHS on the linearised MILP; a QUBO as such of few variables: every state."""

    name: str = "exact"

    def warm_up(self) -> None:
        """Import HiGHS."""
        from dispatcher_daemon.forms import milp  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        from dispatcher_daemon.forms.milp import solve_milp

        began = time.perf_counter()
        if isinstance(problem, BinaryProblem) and problem.choices <= _ENUMERATED:
            lowest = _least_state(problem)
            return Outcome(self.name, "optimal", lowest, time.perf_counter() - began)
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


def _least_state(problem: BinaryProblem) -> frozenset[int]:
    from dispatcher_daemon.forms import energies_of

    coupling = np.zeros((problem.choices, problem.choices))
    for (first, second), saving in problem.pair_savings.items():
        coupling[first, second] = coupling[second, first] = -saving
    best, state, start = np.inf, 0, 0
    for block in energies_of(np.array(problem.costs_kwh), coupling, 0.0):
        at = int(block.argmin())
        if block[at] < best:
            best, state = float(block[at]), start + at
        start += len(block)
    return frozenset(i for i in range(problem.choices) if state >> i & 1)
