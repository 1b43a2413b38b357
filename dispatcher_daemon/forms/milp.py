"""The linearised MILP of each form, solved exactly with HiGHS.

It shares choices, costs and savings with the QUBO and nothing else: in the arc form subtours are
excluded by the classical Miller–Tucker–Zemlin inequalities with continuous orders, in the route
form every stop has its row, whether its coverage is in question or not.

A saving s_ab x_a x_b becomes s_ab y_ab. Of options of one vehicle, or arcs by which it leaves one
place, at most one is chosen. So the y of a with any such group G add up to at most x_a,
Σ_{b∈G} y_ab ≤ x_a, which holds y_ab ≤ x_a and is tighter. Savings push y up, so y = x_a x_b at
every optimum with binary x. Losses push it down; for those of a in G, Σ y_ab ≥ x_a + Σ x_b − 1 too.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import highspy
import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms.problem import ArcProblem, Problem, RouteProblem


@dataclass(frozen=True)
class MilpResult:
    """Answer of the MILP.

    Attributes:
        status: "optimal", "feasible" (time was up), "infeasible" or "timeout" (no answer).
        selected: chosen arcs or options; None without an answer.
        objective_kwh: H_cost − H_platoon of these, re-evaluated; None without an answer.
    """

    status: Literal["optimal", "feasible", "infeasible", "timeout"]
    selected: frozenset[int] | None
    objective_kwh: float | None


_Ints = npt.NDArray[np.int64]
_Terms = tuple[_Ints, npt.NDArray[np.float64]]


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

    def add_groups(self, key: _Ints, head: _Terms, others: Sequence[_Terms], upper: float) -> None:
        """A row ≤ upper for each distinct key: the head of its first entry, the others of all.

        Args:
            key: shape (entries,).
            head: columns and values, shape (entries,) each.
            others: the same, any number of them.
        """
        keys, first, counts = np.unique(key, return_index=True, return_counts=True)
        order = np.argsort(np.concatenate([keys, *(key for _ in others)]), kind="stable")
        columns = np.concatenate([head[0][first], *(column for column, _ in others)])[order]
        values = np.concatenate([head[1][first], *(value for _, value in others)])[order]
        ends = self.start[-1] + np.cumsum(1 + len(others) * counts)
        self.lower += [-highspy.kHighsInf] * len(keys)
        self.upper += [upper] * len(keys)
        self.index += columns.tolist()
        self.value += values.tolist()
        self.start += ends.tolist()


class QuietHighs(highspy.Highs):
    """HiGHS without output, also before it can be told not to."""

    def __init__(self) -> None:
        """Set up without callbacks."""
        super(highspy.Highs, self).__init__()
        self.setOptionValue("output_flag", False)


def build_milp(problem: Problem) -> highspy.HighsLp:
    """The model: columns are x (binary), pair savings y (continuous), orders u (continuous)."""
    n, m = problem.choices, len(problem.pair_savings)
    orders = 0
    rows = _Rows()
    if isinstance(problem, ArcProblem):
        orders = len(problem.customers)
        _arc_rows(problem, rows, n + m)
    elif isinstance(problem, RouteProblem):
        _route_rows(problem, rows)
    _product_rows(problem, rows)

    lp = highspy.HighsLp()
    lp.num_col_ = n + m + orders
    lp.num_row_ = len(rows.lower)
    savings = [-s for s in problem.pair_savings.values()]
    lp.col_cost_ = np.array([*problem.costs_kwh, *savings, *[0.0] * orders])
    lp.col_lower_ = np.zeros(lp.num_col_)
    lp.col_upper_ = np.array([1.0] * (n + m) + [float(orders - 1)] * orders)
    lp.row_lower_ = np.array(rows.lower)
    lp.row_upper_ = np.array(rows.upper)
    lp.a_matrix_.format_ = highspy.MatrixFormat.kRowwise
    lp.a_matrix_.start_ = np.array(rows.start, dtype=np.int32)
    lp.a_matrix_.index_ = np.array(rows.index, dtype=np.int32)
    lp.a_matrix_.value_ = np.array(rows.value)
    integer, continuous = highspy.HighsVarType.kInteger, highspy.HighsVarType.kContinuous
    lp.integrality_ = [integer] * n + [continuous] * (m + orders)
    return lp


def _arc_rows(problem: ArcProblem, rows: _Rows, first_order: int) -> None:
    """H_cust, H_flow and H_depot as equalities, and MTZ."""
    arcs, customers = problem.arcs, problem.customers
    order = {name: first_order + i for i, name in enumerate(customers)}
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
        rows.add({order[start]: 1.0, order[end]: -1.0, **terms}, -highspy.kHighsInf, size - 1)


def _route_rows(problem: RouteProblem, rows: _Rows) -> None:
    """One option for each vehicle, each stop served once."""
    servers: dict[str, dict[int, float]] = {stop: {} for stop in problem.stops}
    for i, option in enumerate(problem.options):
        for stop in option.stops:
            servers[stop][i] = 1.0
    for group in problem.options_of.values():
        rows.add(dict.fromkeys(group, 1.0), 1.0, 1.0)
    for terms in servers.values():
        rows.add(terms, 1.0, 1.0)


def _product_rows(problem: Problem, rows: _Rows) -> None:
    """y_ab = x_a x_b at every optimum; see the module."""
    if not problem.pair_savings:
        return
    ends = np.array(list(problem.pair_savings))
    losses = np.array(list(problem.pair_savings.values())) < 0
    y = problem.choices + np.arange(len(ends))
    number: dict[tuple[str, ...], int] = {}
    group = np.array(
        [
            number.setdefault(_exclusive_group(problem, i), len(number))
            for i in range(problem.choices)
        ]
    )
    # Both ends of each pair have the other one as a partner.
    x, partner = ends.T.ravel(), ends[:, ::-1].T.ravel()
    y, losses = np.tile(y, 2), np.tile(losses, 2)
    key = x * len(number) + group[partner]
    ones = np.ones(len(key))
    rows.add_groups(key, (x, -ones), [(y, ones)], 0.0)
    if losses.any():
        ones = ones[losses]
        columns = [(y[losses], -ones), (partner[losses], ones)]
        rows.add_groups(key[losses], (x[losses], ones), columns, 1.0)


def _exclusive_group(problem: Problem, index: int) -> tuple[str, ...]:
    """Name of a set of choices, this one among them, of which at most one is selected."""
    if isinstance(problem, ArcProblem):
        arc = problem.arcs[index]
        return (arc.vehicle, arc.start)
    if isinstance(problem, RouteProblem):
        return (problem.options[index].vehicle,)
    return (str(index),)


def solve_milp(problem: Problem, deadline_s: float, seed: int = 0) -> MilpResult:
    """Solve to optimality, or as far as time allows.

    Raises:
        RuntimeError: HiGHS refused the model or ended in an unexpected way.
    """
    ends = time.perf_counter() + deadline_s
    model = build_milp(problem)
    solver: Any = QuietHighs()
    for option, value in (
        ("threads", 1),
        ("random_seed", seed % 2**31),
        ("time_limit", max(0.01, ends - time.perf_counter())),
        # Rewards differ by Wh in totals of kWh: the default relative gap of 1e-4 would hide them.
        ("mip_rel_gap", 0.0),
        ("mip_abs_gap", 1e-9),
        # Half the time of small models, and no optimum of them depends on it.
        ("mip_heuristic_run_feasibility_jump", False),
    ):
        solver.setOptionValue(option, value)
    if solver.passModel(model) == highspy.HighsStatus.kError:
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
    values = np.asarray(solver.getSolution().col_value)[: problem.choices]
    selected = frozenset(int(i) for i in np.flatnonzero(values > 0.5))
    return MilpResult(
        "optimal" if in_time else "feasible", selected, problem.objective_kwh(selected)
    )
