"""A mixed-integer linear model of anybody's, solved by HiGHS."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Literal

import highspy
import numpy as np

from slipstream_lab.research.models.highs import TellingHighs

Status = Literal["optimal", "feasible", "infeasible", "unbounded", "timeout", "failed"]


@dataclass(frozen=True)
class MilpModel:
    """A model with constraints, integers or real variables."""

    lp: highspy.HighsLp
    warnings: tuple[str, ...] = ()

    @property
    def maximised(self) -> bool:
        """Whether the objective is maximised."""
        return bool(self.lp.sense_ == highspy.ObjSense.kMaximize)

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
        warnings: HiGHS's, of the search.
    """

    status: Status
    objective: float | None
    bound: float | None
    values: dict[str, float]
    wall_s: float
    warnings: tuple[str, ...] = ()


def solve_milp_model(model: MilpModel, deadline_s: float, seed: int) -> MilpAnswer:
    """Search until the optimum is proven or the deadline is there."""
    began = time.perf_counter()
    solver: Any = TellingHighs()
    for option, value in (
        ("threads", 1),
        ("random_seed", seed % 2**31),
        ("time_limit", 0.9 * deadline_s),
        ("mip_rel_gap", 0.0),
    ):
        solver.setOptionValue(option, value)
    with solver.told() as warnings:
        solver.passModel(model.lp)
        solver.run()
    kinds = highspy.HighsModelStatus
    ended, info = solver.getModelStatus(), solver.getInfo()
    if ended == kinds.kUnboundedOrInfeasible:
        left_s = max(0.1, deadline_s - (time.perf_counter() - began))
        ended = kinds.kUnbounded if _has_solution(model.lp, left_s) else kinds.kInfeasible
    feasible = info.primal_solution_status == highspy.SolutionStatus.kSolutionStatusFeasible
    status: Status
    if ended == kinds.kOptimal:
        status = "optimal"
    elif ended == kinds.kInfeasible:
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
        warnings=tuple(warnings),
    )


def _has_solution(lp: highspy.HighsLp, limit_s: float) -> bool:
    """Whether the constraints have a solution, which presolve may leave open; without an objective
    nothing is unbounded.
    """
    solver: Any = TellingHighs()
    solver.setOptionValue("threads", 1)
    solver.setOptionValue("time_limit", limit_s)
    solver.passModel(lp)
    columns = np.arange(lp.num_col_, dtype=np.int32)
    solver.changeColsCost(len(columns), columns, np.zeros(len(columns)))
    solver.run()
    return bool(solver.getModelStatus() == highspy.HighsModelStatus.kOptimal)
