"""The route form as a QUBO: one option for each vehicle, every stop served once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from dispatcher_daemon.formulations.qubo import QuboModel, add_square, empty_bqm
from dispatcher_daemon.problem import RouteProblem


@dataclass(frozen=True)
class OptionVariable:
    """x_{k,r}: vehicle k takes its option number r."""

    vehicle: str
    number: int

    def __str__(self) -> str:
        return f"x[{self.vehicle}:{self.number}]"


def build_route_model(problem: RouteProblem, gamma: float | None = None) -> QuboModel:
    """Build the QUBO: no auxiliary variable, one x for each option.

    Each vehicle's one-hot row and the coverage row of each stop that needs one are squared. Their
    coefficients are integers, so the penalty is 0 in valid selections and at least 1 in others.

    Args:
        gamma: penalty weight, kWh; None: `sufficient_route_gamma`.
    """
    numbers = {i: n for group in problem.options_of.values() for n, i in enumerate(group)}
    variables = tuple(
        OptionVariable(option.vehicle, numbers[i]) for i, option in enumerate(problem.options)
    )
    penalty = empty_bqm(variables)
    for row in constraint_rows(problem):
        add_square(penalty, {variables[i]: 1 for i in row}, -1)
    objective = empty_bqm(variables)
    for variable, option in zip(variables, problem.options, strict=True):
        objective.add_linear(variable, option.cost_kwh)
    for (first, second), saving in problem.savings.items():
        objective.add_quadratic(variables[first], variables[second], -saving)
    if gamma is None:
        gamma = sufficient_route_gamma(problem)
    return QuboModel(problem, variables, objective, penalty, gamma)


def constraint_rows(problem: RouteProblem) -> Iterator[tuple[int, ...]]:
    """Sets of options of which exactly one must be selected.

    One set for each vehicle, and one for each stop: the options that serve it. A stop's set that
    is one vehicle's set says nothing new and is left out, as is one that came before.
    """
    seen: set[tuple[int, ...]] = set()
    for options in problem.options_of.values():
        seen.add(options)
        yield options
    for stop in problem.stops:
        row = tuple(i for i, option in enumerate(problem.options) if stop in option.stops)
        if row not in seen:
            seen.add(row)
            yield row


def sufficient_route_gamma(problem: RouteProblem) -> float:
    """A γ in kWh that puts every infeasible state above every feasible one.

    A broken row costs at least 1, so γ > max_feasible f − min_all f is enough for f = H_cost −
    H_platoon. Above, a feasible state has one option of each vehicle: f ≤ Σ_k max_r c_{k,r}, as
    savings are positive. Below, x_a x_b ≤ (x_a + x_b)/2 gives f ≥ Σ_a min(0, c_a − ½ Σ_b s_ab).
    """
    costs = [option.cost_kwh for option in problem.options]
    above = sum(
        (max((costs[i] for i in options), default=0.0) for options in problem.options_of.values()),
        0.0,
    )
    reduced = list(costs)
    for (first, second), saving in problem.savings.items():
        reduced[first] -= saving / 2
        reduced[second] -= saving / 2
    below = sum((min(0.0, value) for value in reduced), 0.0)
    # The margin keeps "greater than" true in floating point.
    return 1.01 * (above - below) + 1e-6
