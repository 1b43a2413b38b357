"""The route form as a QUBO: one option for each vehicle, every stop served once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms.problem import RouteProblem
from dispatcher_daemon.forms.qubo import QuboModel, add_square, empty_bqm


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
    first, second, saving = _pairs(problem)
    import dimod

    bqm: Any = dimod.BinaryQuadraticModel
    objective = bqm.from_numpy_vectors(
        np.array(problem.costs_kwh, dtype=np.float64),
        (first, second, -saving),
        0.0,
        "BINARY",
        variable_order=variables,
    )
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
    costs = np.array(problem.costs_kwh, dtype=np.float64)
    groups = [list(group) for group in problem.options_of.values() if group]
    number = np.zeros(len(costs), dtype=np.int64)
    for vehicle, group in enumerate(groups):
        number[group] = vehicle
    first, second, saving = _pairs(problem)
    k, m = number[first], number[second]
    halves = []
    for size in (np.maximum(saving, 0.0), np.maximum(-saving, 0.0)):
        largest = np.zeros((len(groups), len(groups)))
        np.maximum.at(largest, (np.minimum(k, m), np.maximum(k, m)), size)
        halves.append((largest.sum(axis=0) + largest.sum(axis=1)) / 2)
    saved, lost = halves
    reduced = costs.copy()
    for end in (first, second):
        np.subtract.at(reduced, end, np.maximum(saving, 0.0) / 2)

    highest = spread = extra = 0.0
    for group, half_saved, half_lost in zip(groups, saved, lost, strict=True):
        ordered = np.sort(costs[group])
        most = float(ordered[-1] + half_lost)
        highest += most
        spread += most - float(ordered[0]) + float(half_saved)
        n = np.array([0, *range(2, len(group) + 1)])
        total = np.append(0.0, np.cumsum(ordered))[n]
        worse = (ordered[0] - total + (n * n - 1) * half_saved) / (n - 1) ** 2
        extra = max(extra, float(worse.max()))
    lowest = float(np.minimum(reduced, 0.0).sum())
    # The margin keeps "greater than" true in floating point.
    return 1.01 * min(highest - lowest, spread + extra) + 1e-6


def _pairs(
    problem: RouteProblem,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Savings as arrays: first option, second option, kWh; shape (pairs,) each."""
    ends = np.array(list(problem.savings), dtype=np.int64).reshape(-1, 2)
    return ends[:, 0], ends[:, 1], np.array(list(problem.savings.values()), dtype=np.float64)
