"""Circuits that are only a width, for workers that must start quickly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dispatcher_daemon.forms.problem import Problem
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.quantum.hardware.circuits import BuiltCircuit
from dispatcher_daemon.solvers.quantum.lc_qaoa import Place


@dataclass(frozen=True)
class Width:
    """A circuit of so many qubits."""

    num_qubits: int


@dataclass(frozen=True)
class LightBuilder:
    """One qubit an arc; any samples lead to the first arc."""

    name: str = "lc-qaoa"
    encoding: str = "light"

    def warm_up(self) -> None:
        """Nothing to import."""

    def build(
        self, problem: Problem, deadline_s: float, seed: int, place: Place | None = None
    ) -> BuiltCircuit:
        """No training."""
        n = problem.choices
        return BuiltCircuit(Width(n), tuple(range(n)), "f" * 16, "ramp", 2, 0.0)

    def decode(
        self, problem: Problem, order: Sequence[int], samples: Mapping[str, int], seed: int
    ) -> Outcome:
        """The first arc."""
        return Outcome(self.name, "feasible", frozenset({0}), 0.0)
