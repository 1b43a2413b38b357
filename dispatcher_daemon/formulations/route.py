"""The route form as a QUBO: one option for each vehicle, every stop served once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

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

    Let P be the penalty of an infeasible state, f = H_cost − H_platoon, n_k the number of options
    that it selects of vehicle k, C_k(n) the sum of the n lowest costs of k, S_kl the largest saving
    and R_kl the largest loss (saving below 0) of k and l together, T_k = Σ_l S_kl, M_k the highest
    cost of k plus ½ Σ_l R_kl. Feasible states have f ≤ Σ_k M_k. Two bounds from below on f of any
    state, losses left out; the better is taken:

    - x_a x_b ≤ (x_a + x_b)/2 gives f ≥ Σ_a min(0, c_a − ½ Σ_b s_ab) =: L. With P ≥ 1,
      γ > Σ_k M_k − L is enough.
    - Of k and l at most n_k n_l ≤ (n_k² + n_l²)/2 pairs are selected, so f ≥ Σ_k [C_k(n_k) −
      ½ n_k² T_k]. With w_k = M_k − C_k(1) + ½ T_k, W = Σ_k w_k and e_k(n) = C_k(1) − C_k(n) +
      ½ (n² − 1) T_k, the difference to Σ_k M_k is at most W + Σ_{k: n_k≠1} e_k(n_k), which is
      at most W + E Q for E = max(0, max_{k, n≠1} e_k(n)/(n − 1)²) and Q = Σ_k (n_k − 1)². As
      P ≥ max(1, Q), γ > W + E is enough: the spread of the valid states' objectives and the price
      of one vehicle more or less, where the first bound has the whole cost.
    """
    costs = problem.costs_kwh
    groups = {k: group for k, group in problem.options_of.items() if group}
    reduced = list(costs)
    most_saved: dict[tuple[str, str], float] = {}
    most_lost: dict[tuple[str, str], float] = {}
    for (first, second), saving in problem.savings.items():
        one, other = sorted(problem.options[i].vehicle for i in (first, second))
        largest = most_saved if saving > 0 else most_lost
        largest[one, other] = max(largest.get((one, other), 0.0), abs(saving))
        if saving > 0:
            reduced[first] -= saving / 2
            reduced[second] -= saving / 2
    saved, lost = dict.fromkeys(groups, 0.0), dict.fromkeys(groups, 0.0)
    for largest, halves in ((most_saved, saved), (most_lost, lost)):
        for pair, value in largest.items():
            for vehicle in pair:
                halves[vehicle] += value / 2

    highest = spread = extra = 0.0
    for vehicle, group in groups.items():
        ordered = sorted(costs[i] for i in group)
        most = ordered[-1] + lost[vehicle]
        highest += most
        spread += most - ordered[0] + saved[vehicle]
        for n, total in enumerate([0.0, *accumulate(ordered)]):
            if n != 1:
                worse = ordered[0] - total + (n * n - 1) * saved[vehicle]
                extra = max(extra, worse / (n - 1) ** 2)
    lowest = sum((min(0.0, value) for value in reduced), 0.0)
    # The margin keeps "greater than" true in floating point.
    return 1.01 * min(highest - lowest, spread + extra) + 1e-6
