"""A mixed-integer linear model of anybody's, solved by HiGHS."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal

import highspy

from dispatcher_daemon.formulations.milp import QuietHighs

Status = Literal["optimal", "feasible", "infeasible", "unbounded", "timeout", "failed"]


@dataclass(frozen=True)
class MilpModel:
    """A model with constraints, integers or real variables.

    Attributes:
        lp: as HiGHS read it.
    """

    lp: highspy.HighsLp

    @property
    def integers(self) -> int:
        """Number of integer variables, binary ones included."""
        kind = highspy.HighsVarType
        whole = (kind.kInteger, kind.kSemiInteger)
        return sum(1 for of in self.lp.integrality_ if of in whole)


@dataclass(frozen=True)
class MilpAnswer:
    """What HiGHS found.

    Attributes:
        status: "feasible": the deadline came before the proof; "timeout": before an answer.
        objective: of the model; None without an answer.
        bound: no solution is better; None where there is none.
        values: of the variables that are not 0, by name.
        wall_s: of the search.
    """

    status: Status
    objective: float | None
    bound: float | None
    values: dict[str, float]
    wall_s: float


def solve_milp_model(model: MilpModel, deadline_s: float, seed: int) -> MilpAnswer:
    """Search until the optimum is proven or the deadline is there.

    Args:
        seed: of HiGHS.
    """
    began = time.perf_counter()
    solver: Any = QuietHighs()
    for option, value in (
        ("threads", 1),
        ("random_seed", seed % 2**31),
        ("time_limit", 0.9 * deadline_s),
        ("mip_rel_gap", 0.0),
    ):
        solver.setOptionValue(option, value)
    solver.passModel(model.lp)
    solver.run()
    ended, info, kinds = solver.getModelStatus(), solver.getInfo(), highspy.HighsModelStatus
    feasible = info.primal_solution_status == highspy.SolutionStatus.kSolutionStatusFeasible
    status: Status
    if ended == kinds.kOptimal:
        status = "optimal"
    elif ended in (kinds.kInfeasible, kinds.kUnboundedOrInfeasible):
        status = "infeasible"
    elif ended == kinds.kUnbounded:
        status = "unbounded"
    elif ended == kinds.kTimeLimit:
        status = "feasible" if feasible else "timeout"
    else:
        status = "failed"
    found = status in ("optimal", "feasible")
    whole = status in ("feasible", "optimal") and model.integers > 0
    bound = float(info.mip_dual_bound) if whole else None
    if status == "optimal" and not model.integers:
        bound = float(info.objective_function_value)
    values = solver.getSolution().col_value if found else []
    names = model.lp.col_names_
    return MilpAnswer(
        status=status,
        objective=float(info.objective_function_value) if found else None,
        bound=None if bound is None or abs(bound) >= highspy.kHighsInf else bound,
        values={n: float(v) for n, v in zip(names, values, strict=False) if abs(v) > 1e-9},
        wall_s=time.perf_counter() - began,
    )
