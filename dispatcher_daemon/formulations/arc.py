"""The paper's arc form as a QUBO (section III): H_cost − H_platoon + γ H_constraints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dispatcher_daemon.formulations.qubo import Encoding, QuboModel, add_square, empty_bqm
from dispatcher_daemon.formulations.subtours import bits_for, order_rows
from dispatcher_daemon.problem import ArcProblem


@dataclass(frozen=True)
class ArcVariable:
    """x_{ijk}."""

    vehicle: str
    start: str
    end: str

    def __str__(self) -> str:
        return f"x[{self.vehicle}:{self.start}>{self.end}]"


@dataclass(frozen=True)
class OrderBit:
    """Bit of the order variable u_j of a customer, shared by the vehicles; it weighs 2^bit."""

    customer: str
    bit: int

    def __str__(self) -> str:
        return f"u[{self.customer}:{self.bit}]"


@dataclass(frozen=True)
class SlackBit:
    """Slack bit of the order row of the arc (start, end)."""

    start: str
    end: str
    bit: int

    def __str__(self) -> str:
        return f"w[{self.start}>{self.end}:{self.bit}]"


Variable = ArcVariable | OrderBit | SlackBit
"""Arcs come in the problem's order, then order bits, then slack bits."""


def build_arc_model(
    problem: ArcProblem, gamma: float | None = None, encoding: Encoding = "reduced"
) -> QuboModel:
    """Build the QUBO.

    Args:
        gamma: penalty weight, kWh; None: `sufficient_gamma`.
        encoding: how subtours are excluded.
    """
    if encoding != "reduced":
        raise NotImplementedError(f"encoding {encoding!r}")
    x = [ArcVariable(a.vehicle, a.start, a.end) for a in problem.arcs]
    rows = order_rows(problem)
    width = bits_for(len(problem.customers))
    ordered = {name for row in rows for name in (row.start, row.end)}
    order = [OrderBit(c, b) for c in problem.customers if c in ordered for b in range(width)]
    slack = [SlackBit(r.start, r.end, b) for r in rows for b in range(len(r.slack))]
    variables: tuple[Variable, ...] = (*x, *order, *slack)

    penalty = empty_bqm(variables)
    for terms, constant in _degree_rows(problem):
        add_square(penalty, {x[i]: c for i, c in terms.items()}, constant)
    for row in rows:
        coefficients: dict[Variable, int] = {}
        for bit in range(width):
            coefficients[OrderBit(row.start, bit)] = 1 << bit
            coefficients[OrderBit(row.end, bit)] = -(1 << bit)
        for variable in x:
            if (variable.start, variable.end) == (row.start, row.end):
                coefficients[variable] = row.weight
        for bit, weight in enumerate(row.slack):
            coefficients[SlackBit(row.start, row.end, bit)] = weight
        add_square(penalty, coefficients, row.constant)

    objective = empty_bqm(variables)
    for variable, arc in zip(x, problem.arcs, strict=True):
        objective.add_linear(variable, arc.cost_kwh)
    for (first, second), saving in problem.pair_savings.items():
        objective.add_quadratic(x[first], x[second], -saving)
    if gamma is None:
        gamma = sufficient_gamma(problem)
    return QuboModel(problem, variables, objective, penalty, gamma)


def sufficient_gamma(problem: ArcProblem) -> float:
    """A γ in kWh that puts every infeasible state above every feasible one.

    A violated penalty is at least 1, so γ > max_feasible f − min_all f is enough for f = H_cost −
    H_platoon. Above, a feasible state enters each customer once and returns each vehicle once, so
    f is at most the sum of the dearest such arcs. Below, x_a x_b ≤ (x_a + x_b)/2 gives
    f ≥ Σ_a min(0, c_a − ½ Σ_b s_ab).
    """
    into: dict[tuple[str, str], list[float]] = {}
    for arc in problem.arcs:
        key = (arc.end, arc.vehicle if arc.end == problem.depot else "")
        into.setdefault(key, []).append(arc.cost_kwh)
    above = sum((max(costs) for costs in into.values()), 0.0)
    reduced = [arc.cost_kwh for arc in problem.arcs]
    for (first, second), saving in problem.pair_savings.items():
        reduced[first] -= saving / 2
        reduced[second] -= saving / 2
    below = sum((min(0.0, value) for value in reduced), 0.0)
    # The margin keeps "greater than" true in floating point.
    return 1.01 * (above - below) + 1e-6


def _degree_rows(problem: ArcProblem) -> Iterable[tuple[dict[int, int], int]]:
    """H_cust, H_flow and H_depot (paper section III-B) as Σ c_i x_i + constant = 0."""
    arcs = list(enumerate(problem.arcs))
    for customer in problem.customers:
        yield {i: 1 for i, a in arcs if a.end == customer}, -1
    for vehicle in problem.vehicles:
        own = [(i, a) for i, a in arcs if a.vehicle == vehicle]
        for customer in problem.customers:
            flow = {i: 1 for i, a in own if a.end == customer}
            flow |= {i: -1 for i, a in own if a.start == customer}
            if flow:
                yield flow, 0
        yield {i: 1 for i, a in own if a.start == problem.depot}, -1
        yield {i: 1 for i, a in own if a.end == problem.depot}, -1
