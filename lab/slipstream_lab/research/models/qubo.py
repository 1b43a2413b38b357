"""A QUBO of anybody's as the dispatcher's solvers take it."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final

from dispatcher_daemon.forms import BinaryProblem

MAX_VARIABLES: Final = 2000
"""Circuits and their controls keep dense couplings: 32 MB each."""


@dataclass(frozen=True)
class QuboFile:
    """A QUBO and its own units. `problem`: what is minimised, divided by `scale`, so that solvers'
    tolerances fit.
    """

    problem: BinaryProblem
    scale: float = 1.0
    offset: float = 0.0
    warnings: tuple[str, ...] = ()

    def value(self, minimised: float) -> float:
        """The model's own objective of what solvers minimised."""
        return self.scale * minimised + self.offset

    def objective(self, selected: Collection[int]) -> float:
        """The model's own objective of the variables that are 1, by their index."""
        return self.value(self.problem.objective_kwh(selected))

    @property
    def couplings(self) -> int:
        """Pairs of variables with a bias."""
        return sum(1 for saving in self.problem.pair_savings.values() if saving)


def qubo_of(bqm: Any, *, maximise: bool = False) -> QuboFile:
    """Take a `dimod.BinaryQuadraticModel`, of spins or bits. Raises ValueError: no variable, too
    many, two with one name, or a number that is not finite.
    """
    binary = bqm.change_vartype("BINARY", inplace=False)
    names = tuple(str(variable) for variable in binary.variables)
    if not names:
        raise ValueError("no variable")
    if len(names) > MAX_VARIABLES:
        raise ValueError(f"{len(names)} variables; the most is {MAX_VARIABLES}")
    numbers = [*binary.linear.values(), *binary.quadratic.values(), binary.offset]
    if not all(math.isfinite(number) for number in numbers):
        raise ValueError("a number is not finite")
    largest = max(abs(float(number)) for number in numbers[:-1])
    scale = 2.0 ** math.frexp(largest)[1] if largest else 1.0
    scale = -scale if maximise else scale
    index = {variable: i for i, variable in enumerate(binary.variables)}
    pairs = {
        (min(index[u], index[v]), max(index[u], index[v])): -float(bias) / scale
        for (u, v), bias in binary.quadratic.items()
        if bias
    }
    costs = tuple(float(binary.get_linear(v)) / scale for v in binary.variables)
    return QuboFile(BinaryProblem(names, costs, pairs), scale, float(binary.offset))
