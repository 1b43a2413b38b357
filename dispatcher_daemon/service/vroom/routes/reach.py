"""Which tasks a vehicle can come to and leave again, if need be by way of other tasks.

In a given matrix the direct way may be missing where one by another place is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.service.vroom.model import NO_WAY, Van, VroomProblem, VroomVisit, VroomWays

_Bools = npt.NDArray[np.bool_]


class Reach:
    """Answers for the vehicles of one problem; ways lead by places of its tasks."""

    def __init__(self, problem: VroomProblem) -> None:
        self._places = sorted({task.place for task in problem.tasks})
        self._leads = lru_cache(maxsize=None)(self._leads_of)
        self._from = lru_cache(maxsize=None)(self._found_from)

    def serves(self, van: Van, tasks: Sequence[VroomVisit]) -> bool:
        """Whether ways lead from the vehicle's start to the tasks in order and to its end."""
        places = [van.start, *(task.place for task in tasks), van.end]
        return all(
            a is None or b is None or a == b or bool(self._from(van.ways, a)[b])
            for a, b in pairwise(places)
        )

    def _leads_of(self, ways: VroomWays) -> _Bools:
        """Whether a direct way leads, (from, to)."""
        return np.array([np.asarray(row) < NO_WAY for row in ways.duration])

    def _found_from(self, ways: VroomWays, place: int) -> _Bools:
        """Places that ways lead to from one."""
        leads = self._leads(ways)
        through = np.zeros(len(leads), dtype=bool)
        through[self._places] = True
        found: _Bools = leads[place].copy()
        fresh = found & through
        while fresh.any():
            more = leads[fresh].any(axis=0) & ~found
            found |= more
            fresh = more & through
        return found
