"""The paper's arc form as a QUBO (section III): H_cost − H_platoon + γ H_constraints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dispatcher_daemon.forms.problem import ArcProblem
from dispatcher_daemon.forms.qubo import Encoding, QuboModel, add_square, empty_bqm
from dispatcher_daemon.forms.subtours import PrecedenceRow, bits_for, full_rows, order_rows


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
    """Bit of the order variable of a customer; it weighs 2^bit.

    The variable is u_j, shared by the vehicles, or the paper's u_{jk} if a vehicle is named.
    """

    customer: str
    bit: int
    vehicle: str | None = None

    def __str__(self) -> str:
        return f"u[{_owner(self.vehicle)}{self.customer}:{self.bit}]"


@dataclass(frozen=True)
class SlackBit:
    """Slack bit of the order row of the arc (start, end), of one vehicle or of all."""

    start: str
    end: str
    bit: int
    vehicle: str | None = None

    def __str__(self) -> str:
        return f"w[{_owner(self.vehicle)}{self.start}>{self.end}:{self.bit}]"


Variable = ArcVariable | OrderBit | SlackBit
"""Arcs come in the problem's order, then order bits, then slack bits."""


@dataclass(frozen=True)
class PenaltyRow:
    """Σ coefficient · variable + constant, which is 0 where the row holds."""

    coefficients: Mapping[Variable, int]
    constant: int


def build_arc_model(
    problem: ArcProblem, gamma: float | None = None, encoding: Encoding = "reduced"
) -> QuboModel:
    """Build the QUBO.

    Args:
        gamma: penalty weight, kWh; None: `sufficient_gamma`.
        encoding: how subtours are excluded: "reduced" by `order_rows`, "full" by `full_rows`.
    """
    variables, rows = constraint_rows(problem, encoding)
    penalty = empty_bqm(variables)
    for row in rows:
        add_square(penalty, row.coefficients, row.constant)
    objective = empty_bqm(variables)
    for variable, arc in zip(variables, problem.arcs, strict=False):
        objective.add_linear(variable, arc.cost_kwh)
    for (first, second), saving in problem.pair_savings.items():
        objective.add_quadratic(variables[first], variables[second], -saving)
    if gamma is None:
        gamma = sufficient_gamma(problem)
    return QuboModel(problem, variables, objective, penalty, gamma)


def constraint_rows(
    problem: ArcProblem, encoding: Encoding = "reduced"
) -> tuple[tuple[Variable, ...], tuple[PenaltyRow, ...]]:
    """The model's variables, and the rows whose squares add up to H_constraints."""
    x = [ArcVariable(a.vehicle, a.start, a.end) for a in problem.arcs]
    width = bits_for(len(problem.customers))
    if encoding == "full":
        orders = full_rows(problem)
        named = [(k, c) for k in problem.vehicles for c in problem.customers]
        order = [OrderBit(c, bit, k) for k, c in named for bit in range(width)]
    else:
        orders = order_rows(problem)
        used = {name for row in orders for name in (row.start, row.end)}
        order = [OrderBit(c, b) for c in problem.customers if c in used for b in range(width)]
    slack = [SlackBit(r.start, r.end, b, r.vehicle) for r in orders for b in range(len(r.slack))]
    rows = [*_degree_rows(problem, x), *_order_rows(orders, x, width)]
    return (*x, *order, *slack), tuple(rows)


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


def _degree_rows(problem: ArcProblem, x: list[ArcVariable]) -> Iterator[PenaltyRow]:
    """H_cust, H_flow and H_depot (paper section III-B), restricted to candidate arcs."""
    into: dict[tuple[str, str], list[Variable]] = {}
    out: dict[tuple[str, str], list[Variable]] = {}
    for variable in x:
        into.setdefault((variable.vehicle, variable.end), []).append(variable)
        out.setdefault((variable.vehicle, variable.start), []).append(variable)
    for customer in problem.customers:
        entering = [v for k in problem.vehicles for v in into.get((k, customer), ())]
        yield PenaltyRow(dict.fromkeys(entering, 1), -1)
    for vehicle in problem.vehicles:
        for customer in problem.customers:
            flow = dict.fromkeys(into.get((vehicle, customer), ()), 1)
            flow |= dict.fromkeys(out.get((vehicle, customer), ()), -1)
            if flow:
                yield PenaltyRow(flow, 0)
        for group in (out, into):
            yield PenaltyRow(dict.fromkeys(group.get((vehicle, problem.depot), ()), 1), -1)


def _order_rows(
    orders: tuple[PrecedenceRow, ...], x: list[ArcVariable], width: int
) -> Iterator[PenaltyRow]:
    """H_subtour: the order rows over x, order bits and slack bits."""
    arcs: dict[tuple[str | None, str, str], list[Variable]] = {}
    for variable in x:
        for owner in (None, variable.vehicle):
            arcs.setdefault((owner, variable.start, variable.end), []).append(variable)
    for row in orders:
        coefficients: dict[Variable, int] = {}
        for bit in range(width):
            coefficients[OrderBit(row.start, bit, row.vehicle)] = 1 << bit
            coefficients[OrderBit(row.end, bit, row.vehicle)] = -(1 << bit)
        for arc in arcs[row.vehicle, row.start, row.end]:
            coefficients[arc] = row.weight
        for bit, weight in enumerate(row.slack):
            coefficients[SlackBit(row.start, row.end, bit, row.vehicle)] = weight
        yield PenaltyRow(coefficients, row.constant)


def _owner(vehicle: str | None) -> str:
    return "" if vehicle is None else f"{vehicle}:"
