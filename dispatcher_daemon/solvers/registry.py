"""From names in the settings to solvers."""

from __future__ import annotations

from collections.abc import Callable

from dispatcher_daemon.formulations.qubo import Encoding
from dispatcher_daemon.settings import DispatcherSettings, SolverName
from dispatcher_daemon.solvers.cplex import CplexSolver
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.heuristics import AnnealingSolver, TabuSolver
from dispatcher_daemon.solvers.insertion import InsertionSolver
from dispatcher_daemon.solvers.lc_qaoa import LcQaoaSolver
from dispatcher_daemon.solvers.protocol import Solver
from dispatcher_daemon.solvers.qaoa import QaoaSolver

BASELINE_SOLVER: SolverName = "exact"
"""Solves the baseline, whether it is among the solvers asked for the cooperative plan or not."""


def make_solver(
    name: SolverName,
    settings: DispatcherSettings,
    encoding: Encoding = "reduced",
    backend: str | None = None,
) -> Solver:
    """The solver of that name, as configured.

    Args:
        encoding: of the arc form's subtour terms, for solvers of QUBOs.
        backend: for LC-QAOA instead of the settings' simulator; a device too.
    """
    gamma, lc_qaoa = settings.gamma, settings.lc_qaoa
    makers: dict[SolverName, Callable[[], Solver]] = {
        "exact": ExactSolver,
        "cplex": CplexSolver,
        "tabu": lambda: TabuSolver(gamma=gamma, encoding=encoding),
        "annealing": lambda: AnnealingSolver(gamma=gamma, encoding=encoding),
        "insertion": InsertionSolver,
        "lc-qaoa": lambda: LcQaoaSolver(lc_qaoa, gamma, encoding, backend),
        "qaoa": lambda: QaoaSolver(settings.qaoa, gamma=gamma, encoding=encoding),
    }
    return makers[name]()


def configured_solvers(settings: DispatcherSettings) -> list[Solver]:
    """All solvers that a dispatcher needs, each once."""
    asked = (BASELINE_SOLVER, *settings.solvers, *settings.city.solvers)
    names: list[SolverName] = list(dict.fromkeys(asked))
    return [make_solver(name, settings) for name in names]
