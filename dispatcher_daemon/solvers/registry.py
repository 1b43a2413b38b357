"""From names in the settings to solvers."""

from __future__ import annotations

from dispatcher_daemon.settings import DispatcherSettings, SolverName
from dispatcher_daemon.solvers.base import Solver
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.lc_qaoa import LcQaoaSolver

BASELINE_SOLVER: SolverName = "exact"
"""Solves the baseline, whether it is among the solvers asked for the cooperative plan or not."""


def make_solver(name: SolverName, settings: DispatcherSettings) -> Solver:
    """The solver of that name, as configured."""
    if name == "exact":
        return ExactSolver()
    options = settings.lc_qaoa
    return LcQaoaSolver(
        layers=options.layers,
        shots=options.shots,
        delta_beta=options.delta_beta,
        delta_gamma=options.delta_gamma,
        gamma=settings.gamma,
    )


def configured_solvers(settings: DispatcherSettings) -> list[Solver]:
    """All solvers that a dispatcher needs, each once."""
    names: list[SolverName] = list(dict.fromkeys([BASELINE_SOLVER, *settings.solvers]))
    return [make_solver(name, settings) for name in names]
