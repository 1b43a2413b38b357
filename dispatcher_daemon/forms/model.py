"""The QUBO of an arc or route problem."""

from __future__ import annotations

from dispatcher_daemon.forms.arc import build_arc_model
from dispatcher_daemon.forms.problem import ArcProblem, Problem, RouteProblem
from dispatcher_daemon.forms.qubo import Encoding, QuboModel, build_binary_model
from dispatcher_daemon.forms.route import build_route_model

__all__ = ["Encoding", "QuboModel", "build_model"]


def build_model(
    problem: Problem, gamma: float | None = None, *, encoding: Encoding = "reduced"
) -> QuboModel:
    """Build the QUBO of a problem.

    Args:
        gamma: penalty weight, kWh; None: one computed for the problem that suffices.
        encoding: of the arc form's subtour terms; the others have none.
    """
    if isinstance(problem, ArcProblem):
        return build_arc_model(problem, gamma, encoding)
    if isinstance(problem, RouteProblem):
        return build_route_model(problem, gamma)
    return build_binary_model(problem)
