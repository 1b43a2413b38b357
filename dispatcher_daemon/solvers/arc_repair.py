"""Repair of arc selections: depth-first search for valid routes that prefers the selected arcs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import ArcProblem

MAX_STEPS = 500
"""Maximum number of search steps; the 16 arcs of the 25-variable instances need a few."""


def follow_arcs(
    problem: ArcProblem, selections: npt.NDArray[np.int8], max_steps: int = MAX_STEPS
) -> npt.NDArray[np.int8]:
    """Each selection's first valid routes in a depth-first search that prefers its arcs.

    Vehicles are sent out one after the other. From each place the selected arcs are tried before
    the others, cheaper ones first; a dead end takes the last arc back. So a valid selection stays
    as it is, and an invalid one is repaired by cost only, without rewards.

    Args:
        selections: 0 or 1 by arc, shape (selections, arcs).
        max_steps: of each search.

    Returns:
        The same shape; selections that led to no routes within the steps are as they were.
    """
    patterns, inverse = np.unique(selections, axis=0, return_inverse=True)
    repaired = patterns.copy()
    for row, pattern in enumerate(patterns):
        arcs = _RepairSearch(problem, pattern, max_steps).routes()
        if arcs is not None:
            repaired[row] = 0
            repaired[row, arcs] = 1
    return repaired[inverse.ravel()]


class _RepairSearch:
    def __init__(self, problem: ArcProblem, pattern: npt.NDArray[np.int8], max_steps: int) -> None:
        self._problem = problem
        self._steps = max_steps
        arcs = problem.arcs
        self._leaving: dict[tuple[str, str], list[int]] = {}
        for index in sorted(range(len(arcs)), key=lambda i: (-pattern[i], arcs[i].cost_kwh, i)):
            self._leaving.setdefault((arcs[index].vehicle, arcs[index].start), []).append(index)

    def routes(self) -> list[int] | None:
        """Arcs of the first valid routes; None if there are none or the steps are used up."""
        depot = self._problem.depot
        missing = set(self._problem.customers)
        taken: list[int] = []
        stack = [self._arcs_from(0, depot)]
        while stack:
            index = next((i for i in stack[-1] if self._allowed(i, missing)), None)
            self._steps -= 1
            if self._steps < 0:
                return None
            if index is None:
                stack.pop()
                if taken:
                    end = self._problem.arcs[taken.pop()].end
                    missing |= {end} - {depot}
                continue
            arc = self._problem.arcs[index]
            taken.append(index)
            missing.discard(arc.end)
            vehicle = self._problem.vehicles.index(arc.vehicle) + (arc.end == depot)
            if vehicle == len(self._problem.vehicles):
                return taken
            stack.append(self._arcs_from(vehicle, arc.end))
        return None

    def _arcs_from(self, vehicle: int, place: str) -> Iterator[int]:
        return iter(self._leaving.get((self._problem.vehicles[vehicle], place), ()))

    def _allowed(self, index: int, missing: set[str]) -> bool:
        """Whether this arc may come next; the last vehicle goes home when all are served."""
        arc = self._problem.arcs[index]
        if arc.end != self._problem.depot:
            return arc.end in missing
        later = len(self._problem.vehicles) - 1 - self._problem.vehicles.index(arc.vehicle)
        return len(missing) >= later and (later > 0 or not missing)
