"""The QUBO model of both forms: objective + γ · penalty."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from dispatcher_daemon.forms.problem import BinaryProblem, Problem

if TYPE_CHECKING:
    import dimod

Encoding = Literal["reduced", "full"]
"""How the arc form excludes subtours: with the bits that a cycle can need, or with the paper's."""


@dataclass(frozen=True)
class QuboModel:
    """A QUBO of an arc or route problem.

    Attributes:
        variables: x of the problem in its order, then auxiliary bits.
        objective: H_cost − H_platoon, kWh, over all variables.
        penalty: H_constraints, an integer ≥ 0 in every state, over all variables.
        gamma: weight of the penalty, kWh.
    """

    problem: Problem
    variables: tuple[Hashable, ...]
    objective: dimod.BinaryQuadraticModel
    penalty: dimod.BinaryQuadraticModel
    gamma: float

    @cached_property
    def total(self) -> Any:
        """H_total, kWh: a `dimod.BinaryQuadraticModel`."""
        import dimod

        bqm: Any = dimod.BinaryQuadraticModel(self.penalty)
        bqm.scale(self.gamma)
        bqm.update(self.objective)
        return bqm

    def selected(self, bits: Sequence[int]) -> frozenset[int]:
        """Indices of the arcs or options that a state selects; bits as in `variables`."""
        return frozenset(i for i in range(self.problem.choices) if bits[i])


def build_binary_model(problem: BinaryProblem) -> QuboModel:
    """A QUBO as it is, without a penalty."""
    objective = empty_bqm(problem.names)
    for name, cost in zip(problem.names, problem.costs_kwh, strict=True):
        objective.add_linear(name, cost)
    for (first, second), saving in problem.pair_savings.items():
        objective.add_quadratic(problem.names[first], problem.names[second], -saving)
    return QuboModel(problem, problem.names, objective, empty_bqm(problem.names), 1.0)


def empty_bqm(variables: Iterable[Hashable]) -> Any:
    """A zero model over the variables, in their order."""
    import dimod  # a tenth of a second, which only workers need

    bqm = dimod.BinaryQuadraticModel("BINARY")
    for variable in variables:
        bqm.add_variable(variable)
    return bqm


def add_square(bqm: Any, coefficients: Mapping[Any, int], constant: int) -> None:
    """Add (Σ c_i x_i + constant)², with x_i² = x_i."""
    items = list(coefficients.items())
    bqm.offset += constant**2
    for position, (u, a) in enumerate(items):
        bqm.add_linear(u, a * a + 2 * a * constant)
        for v, b in items[position + 1 :]:
            bqm.add_quadratic(u, v, 2 * a * b)
