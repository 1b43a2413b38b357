"""CPLEX on the MILP's model file, as an independent exact solver (extra ``cplex``)."""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dispatcher_daemon.forms import Problem
from dispatcher_daemon.solvers.protocol import Outcome, Status

_OPTIMAL = (101, 102)  # within the gap of 1e-9 kWh that is asked for
_INFEASIBLE = 103
_TIME_LIMIT = (107, 108)  # with and without a selection


@dataclass(frozen=True)
class CplexSolver:
    """CPLEX on the MPS file of the linearised MILP; it shares nothing else with `ExactSolver`.

    The Community Edition takes at most 1,000 variables and 1,000 constraints; beyond, the outcome
    is "failed" with CPLEX's own message.
    """

    name: str = "cplex"

    def warm_up(self) -> None:
        """Import CPLEX.

        Raises:
            ModuleNotFoundError: the extra is not installed.
        """
        import cplex  # noqa: F401

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`."""
        import cplex

        from dispatcher_daemon.forms.files import write_milp

        began = time.perf_counter()
        with tempfile.TemporaryDirectory(prefix="slipstream-") as folder:
            path = Path(folder) / "model.mps"
            write_milp(problem, path)
            model: Any = cplex.Cplex()
            try:
                for mute in (
                    model.set_log_stream,
                    model.set_results_stream,
                    model.set_warning_stream,
                    model.set_error_stream,
                ):
                    mute(None)
                model.read(str(path))
                model.parameters.threads.set(1)
                model.parameters.randomseed.set(seed % 2**31)
                model.parameters.mip.tolerances.mipgap.set(0.0)
                model.parameters.mip.tolerances.absmipgap.set(1e-9)
                left_s = 0.8 * deadline_s - (time.perf_counter() - began)
                model.parameters.timelimit.set(max(0.01, left_s))
                model.solve()
                return self._outcome(model, began)
            finally:
                model.end()

    def _outcome(self, model: Any, began: float) -> Outcome:
        code = model.solution.get_status()
        selected = None
        status: Status
        if model.solution.is_primal_feasible():
            status = "optimal" if code in _OPTIMAL else "feasible"
            names, values = model.variables.get_names(), model.solution.get_values()
            selected = frozenset(
                int(name[1 : name.index("_")])
                for name, value in zip(names, values, strict=True)
                if name.startswith("x") and value > 0.5
            )
            reason = None
        elif code == _INFEASIBLE:
            status, reason = "infeasible", "no valid route set exists"
        elif code in _TIME_LIMIT:
            status, reason = "timeout", "no answer within the deadline"
        else:
            status, reason = "failed", f"CPLEX ended with {model.solution.get_status_string()}"
        return Outcome(self.name, status, selected, time.perf_counter() - began, reason=reason)
