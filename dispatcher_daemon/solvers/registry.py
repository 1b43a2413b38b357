"""Registry of solvers by name: built-in ones, and those that installed packages add.

A package adds a solver by an entry point of the group ``slipstream.solvers`` whose name is the
solver's and whose object is a `Factory`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.forms import Encoding
from dispatcher_daemon.settings import SOLVER_ENTRY_POINTS, DispatcherSettings
from dispatcher_daemon.solvers.cplex import CplexSolver
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.heuristics import AnnealingSolver, TabuSolver
from dispatcher_daemon.solvers.insertion import InsertionSolver
from dispatcher_daemon.solvers.protocol import Solver
from dispatcher_daemon.solvers.quantum.lc_qaoa import LcQaoaSolver
from dispatcher_daemon.solvers.quantum.qaoa import QaoaSolver
from slipstream.plugins import find_plugin

BASELINE_SOLVER: Final = "exact"
"""Solver of the baseline, whether or not it is among the solvers of the cooperative plan."""


@dataclass(frozen=True)
class SolverOptions:
    """Arguments of a solver's factory.

    Attributes:
        encoding: of the arc form's subtour terms, for solvers of QUBOs.
    """

    settings: DispatcherSettings
    encoding: Encoding = "reduced"


Factory = Callable[[SolverOptions], Solver]

_FACTORIES: Final[Mapping[str, Factory]] = {
    "exact": lambda _: ExactSolver(),
    "cplex": lambda _: CplexSolver(),
    "tabu": lambda o: TabuSolver(gamma=o.settings.gamma, encoding=o.encoding),
    "annealing": lambda o: AnnealingSolver(gamma=o.settings.gamma, encoding=o.encoding),
    "insertion": lambda _: InsertionSolver(),
    "lc-qaoa": lambda o: LcQaoaSolver(o.settings.lc_qaoa, o.settings.gamma, o.encoding),
    "qaoa": lambda o: QaoaSolver(o.settings.qaoa, gamma=o.settings.gamma, encoding=o.encoding),
}


def make_solver(name: str, settings: DispatcherSettings, encoding: Encoding = "reduced") -> Solver:
    """The solver of that name, as configured; for the arguments see `SolverOptions`.

    Raises:
        InputError: there is no such solver, or the package that adds it cannot be loaded.
    """
    factory = find_plugin(SOLVER_ENTRY_POINTS, name, _FACTORIES, "solver")
    return factory(SolverOptions(settings, encoding))


def configured_solvers(settings: DispatcherSettings) -> list[Solver]:
    """All solvers that a dispatcher needs, each once."""
    asked = (BASELINE_SOLVER, *settings.solvers, *settings.city.solvers)
    return [make_solver(name, settings) for name in dict.fromkeys(asked)]
