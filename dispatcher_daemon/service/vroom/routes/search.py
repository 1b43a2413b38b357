"""Routes by PyVRP: every task if that is possible, else those of most priority."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from typing import Final

import pyvrp
from pyvrp.exceptions import PenaltyBoundWarning
from pyvrp.stop import MaxRuntime, MultipleCriteria, NoImprovement, StoppingCriterion

from dispatcher_daemon.planning.routes import HIGH_PENALTIES, NO_PATH_MWH, search_parameters
from dispatcher_daemon.service.vroom.model import VroomProblem, VroomVisit
from dispatcher_daemon.service.vroom.routes.vrp_data import Routes, VrpData
from dispatcher_daemon.service.vroom.timing import Timetable

_PATIENCE: Final = 1000
_PATIENCE_PER_TASK: Final = 100
"""Iterations without a better answer that end a search."""
_FEASIBLE_SHARE: Final = 0.3
"""Of the time, to find routes that serve every task."""


def search(
    problem: VroomProblem,
    tasks: Sequence[VroomVisit],
    limit_s: float,
    seed: int,
    start: Sequence[Timetable] = (),
) -> Routes:
    """Routes; the same for the same seed, unless time ends the search.

    Args:
        tasks: some of the problem's; shipments whole.
    """
    if not tasks:
        return {}
    vrp, ends = VrpData(problem, tasks), time.monotonic() + limit_s
    for required in (True, False):
        left_s = ends - time.monotonic()
        if left_s <= 0:
            break
        best = _solve(vrp, required, left_s, seed, len(tasks), start)
        if best.is_feasible() and best.distance() < NO_PATH_MWH:
            return vrp.read(best)
    return {}


def _solve(
    vrp: VrpData,
    required: bool,
    limit_s: float,
    seed: int,
    tasks: int,
    start: Sequence[Timetable],
) -> pyvrp.Solution:
    data = vrp.data(required)
    patience = _PATIENCE + _PATIENCE_PER_TASK * tasks
    stop: list[StoppingCriterion] = [MaxRuntime(limit_s), NoImprovement(patience)]
    if required:
        stop.append(_Infeasible(_FEASIBLE_SHARE * limit_s, patience))
    with warnings.catch_warnings():
        # PyVRP warns when windows are tight; whether the answer keeps them is looked at later.
        warnings.simplefilter("ignore", PenaltyBoundWarning)
        result = pyvrp.solve(
            data,
            MultipleCriteria(stop),
            seed=seed % 2**32,
            collect_stats=False,
            display=False,
            params=search_parameters(
                pyvrp.PenaltyParams() if required else HIGH_PENALTIES, long=True
            ),
            initial_solution=vrp.solution(data, start) if start else None,
        )
    return result.best


class _Infeasible:
    """Ends a search that has found nothing feasible after some time, or some iterations."""

    def __init__(self, limit_s: float, max_iterations: int) -> None:
        self._ends, self._left = time.monotonic() + limit_s, max_iterations

    def __call__(self, best_cost: float) -> bool:
        self._left -= 1
        return best_cost >= NO_PATH_MWH and (self._left <= 0 or time.monotonic() > self._ends)
