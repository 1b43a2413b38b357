"""The linearised MILP of the arc form, solved exactly with HiGHS.

It shares arcs, costs and rewards with the QUBO and nothing else: subtours are excluded by the
classical Miller–Tucker–Zemlin inequalities with continuous orders, products by y ≤ x_a, y ≤ x_b.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import highspy
import numpy as np

from dispatcher_daemon.problem import ArcProblem


@dataclass(frozen=True)
class MilpResult:
    """Answer of the MILP.

    Attributes:
        status: "optimal", "feasible" (time was up), "infeasible" or "timeout" (no answer).
        selected: chosen arcs; None without an answer.
        objective_kwh: H_cost − H_platoon of these arcs, re-evaluated; None without an answer.
    """

    status: Literal["optimal", "feasible", "infeasible", "timeout"]
    selected: frozenset[int] | None
    objective_kwh: float | None


@dataclass
class _Rows:
    """Rows lower ≤ Σ value x ≤ upper, gathered in compressed form."""

    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    start: list[int] = field(default_factory=lambda: [0])
    index: list[int] = field(default_factory=list)
    value: list[float] = field(default_factory=list)

    def add(self, terms: dict[int, float], lower: float, upper: float) -> None:
        self.lower.append(lower)
        self.upper.append(upper)
        self.index += terms.keys()
        self.value += terms.values()
        self.start.append(len(self.index))


def build_milp(problem: ArcProblem) -> highspy.HighsLp:
    """The model: columns are arcs (binary), pair savings y (continuous) and orders u (continuous).

    Rewards only push y up, so y ≤ x_a and y ≤ x_b make y = x_a x_b at every optimum.
    """
    arcs, pairs = problem.arcs, problem.pair_savings
    n, m, customers = len(arcs), len(pairs), problem.customers
    order = {name: n + m + i for i, name in enumerate(customers)}
    infinity = highspy.kHighsInf
    rows = _Rows()
    for customer in customers:
        rows.add({i: 1.0 for i, a in enumerate(arcs) if a.end == customer}, 1.0, 1.0)
    for vehicle in problem.vehicles:
        own = [(i, a) for i, a in enumerate(arcs) if a.vehicle == vehicle]
        for customer in customers:
            flow = {i: 1.0 for i, a in own if a.end == customer}
            flow |= {i: -1.0 for i, a in own if a.start == customer}
            rows.add(flow, 0.0, 0.0)
        rows.add({i: 1.0 for i, a in own if a.start == problem.depot}, 1.0, 1.0)
        rows.add({i: 1.0 for i, a in own if a.end == problem.depot}, 1.0, 1.0)
    for start, end in sorted({(a.start, a.end) for a in arcs}):
        if problem.depot in (start, end):
            continue
        size = float(len(customers))
        terms = {i: size for i, a in enumerate(arcs) if (a.start, a.end) == (start, end)}
        rows.add({order[start]: 1.0, order[end]: -1.0, **terms}, -infinity, size - 1)
    for position, pair in enumerate(pairs):
        for arc in pair:
            rows.add({n + position: 1.0, arc: -1.0}, -infinity, 0.0)

    lp = highspy.HighsLp()
    lp.num_col_ = n + m + len(customers)
    lp.num_row_ = len(rows.lower)
    lp.col_cost_ = np.array(
        [a.cost_kwh for a in arcs] + [-s for s in pairs.values()] + [0.0] * len(customers)
    )
    lp.col_lower_ = np.zeros(lp.num_col_)
    lp.col_upper_ = np.array([1.0] * (n + m) + [float(len(customers) - 1)] * len(customers))
    lp.row_lower_ = np.array(rows.lower)
    lp.row_upper_ = np.array(rows.upper)
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_ = np.array(rows.start, dtype=np.int32)
    lp.a_matrix_.index_ = np.array(rows.index, dtype=np.int32)
    lp.a_matrix_.value_ = np.array(rows.value)
    integer, continuous = highspy.HighsVarType.kInteger, highspy.HighsVarType.kContinuous
    lp.integrality_ = [integer] * n + [continuous] * (m + len(customers))
    return lp


def solve_milp(problem: ArcProblem, deadline_s: float, seed: int = 0) -> MilpResult:
    """Solve to optimality, or as far as time allows.

    Raises:
        RuntimeError: HiGHS refused the model or ended in an unexpected way.
    """
    solver: Any = highspy.Highs()  # type: ignore[no-untyped-call]
    for option, value in (
        ("output_flag", False),
        ("threads", 1),
        ("random_seed", seed % 2**31),
        ("time_limit", max(0.01, deadline_s)),
        # Rewards differ by Wh in totals of kWh: the default relative gap of 1e-4 would hide them.
        ("mip_rel_gap", 0.0),
        ("mip_abs_gap", 1e-9),
    ):
        solver.setOptionValue(option, value)
    if solver.passModel(build_milp(problem)) == highspy.HighsStatus.kError:
        raise RuntimeError("HiGHS refused the model")
    solver.run()
    status = solver.getModelStatus()
    info = solver.getInfo()
    if status == highspy.HighsModelStatus.kInfeasible:
        return MilpResult("infeasible", None, None)
    in_time = status == highspy.HighsModelStatus.kOptimal
    if not in_time and status != highspy.HighsModelStatus.kTimeLimit:
        raise RuntimeError(f"HiGHS ended with {solver.modelStatusToString(status)}")
    if info.primal_solution_status != highspy.SolutionStatus.kSolutionStatusFeasible:
        return MilpResult("timeout", None, None)
    values = np.asarray(solver.getSolution().col_value)[: len(problem.arcs)]
    selected = frozenset(int(i) for i in np.flatnonzero(values > 0.5))
    return MilpResult(
        "optimal" if in_time else "feasible", selected, problem.objective_kwh(selected)
    )
