"""Locations of a search and the matrices between them, in PyVRP's terms.

Each step has a location of its own: what its service costs and takes beyond the least of all
vehicles is part of the ways there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from dispatcher_daemon.planning.routes import NO_PATH_MWH
from dispatcher_daemon.service.vroom.model import COST_UNITS, FOREVER, NO_WAY, Van, VroomVisit

_MAX_COST: Final = 10**9
"""Of a way, in PyVRP's units, far from what counts as no way."""
_FINEST: Final = COST_UNITS // 100
"""Internal cost of one of PyVRP's units: a hundredth of the answer's, or more."""


class VrpWays:
    """Locations: ends of vehicles, then steps.

    Attributes:
        depots: rows in the problem's matrices where vehicles begin and end; None: anywhere.
        location: by number of the step's task.
        unit: internal cost of one of PyVRP's.
        detour: more than serving one task can cost, in PyVRP's units.
    """

    def __init__(self, vans: Sequence[Van], steps: Sequence[VroomVisit]) -> None:
        self._steps = steps
        self.depots = list(dict.fromkeys(end for van in vans for end in (van.start, van.end)))
        profiles: dict[object, Van] = {}
        for van in vans:
            profiles.setdefault(_profile(van), van)
        self._profiles = list(profiles)
        self.drivers = list(profiles.values())
        self.location = {task.number: i for i, task in enumerate(steps, len(self.depots))}
        self._places = [*self.depots, *(task.place for task in steps)]
        found = map(self._costs, self.drivers)
        dearest = int(max((c[np.isfinite(c)].max(initial=0) for c in found), default=0))
        fixed = COST_UNITS * max(van.spec.costs.fixed for van in vans)
        self.unit = max(_FINEST, -(-max(dearest, fixed) // _MAX_COST))
        self.detour = 2 * (dearest + fixed) // self.unit + 1

    def profile(self, van: Van) -> int:
        """Number of a vehicle's profile."""
        return self._profiles.index(_profile(van))

    def costs(self) -> list[Any]:
        """By profile, PyVRP's units, shape (locations, locations)."""
        found = []
        for cost in map(self._costs, self.drivers):
            reached = np.isfinite(cost)
            units = np.rint(np.where(reached, cost, 0) / self.unit)
            found.append(np.where(reached, units, NO_PATH_MWH).astype(np.int64))
        return found

    def times(self) -> list[Any]:
        """By profile, hundredths of a second, shape (locations, locations)."""
        return [self._times(van) for van in self.drivers]

    def service(self, task: VroomVisit) -> int:
        """The least of all vehicles, hundredths of a second.

        Set-up counts as service where there is a window, as it begins within.
        """
        return min(_work(van, task) for van in self.drivers)

    def whole_work(self) -> int:
        """More time than all steps and the ways to them can take, hundredths of a second."""
        work = sum(max(sum(van.action(task)) for van in self.drivers) for task in self._steps)
        found = (self._between(van.ways.duration) for van in self.drivers)
        return work + len(self._places) * int(max(t[t < NO_WAY].max(initial=0) for t in found))

    def _between(self, rows: Sequence[Sequence[int]]) -> Any:
        """A matrix between locations; nothing to and from where a vehicle has no start or end."""
        at = np.array([0 if place is None else place for place in self._places])
        found = np.asarray(rows, dtype=np.int64)[np.ix_(at, at)]
        nowhere = np.array([place is None for place in self._places])
        found[nowhere, :] = 0
        found[:, nowhere] = 0
        return found

    def _setups(self, van: Van) -> Any:
        """Set-up at the second of two locations, where it is another place than the first."""
        places = np.array([-1 if place is None else place for place in self._places])
        setup = np.zeros(len(places), dtype=np.int64)
        for task in self._steps:
            setup[self.location[task.number]] = van.action(task)[0]
        return np.where(places[:, None] != places[None], setup[None], 0)

    def _times(self, van: Van) -> Any:
        times, setups = self._between(van.ways.duration), self._setups(van)
        blocked = times >= NO_WAY
        for task in self._steps:
            location = self.location[task.number]
            times[location] += _work(van, task) - self.service(task)
            if _has_window(task):
                setups[:, location] = 0
        times += setups
        times[blocked] = 0
        np.fill_diagonal(times, 0)
        return times

    def _costs(self, van: Van) -> Any:
        """Internal costs as floats, inf where no road leads."""
        cost = self._between(van.ways.cost).astype(np.float64)
        per_task_hour = van.spec.costs.per_task_hour
        if per_task_hour:
            cost += per_task_hour * self._setups(van)
            for task in self._steps:
                cost[:, self.location[task.number]] += per_task_hour * van.action(task)[1]
        cost[self._between(van.ways.duration) >= NO_WAY] = np.inf
        np.fill_diagonal(cost, 0)
        return cost


def _has_window(task: VroomVisit) -> bool:
    return task.windows != ((0, FOREVER),)


def _work(van: Van, task: VroomVisit) -> int:
    setup, service = van.action(task)
    return service + setup if _has_window(task) else service


def _profile(van: Van) -> object:
    """Vehicles with the same have the same ways, and take and cost the same at tasks."""
    return id(van.ways), van.spec.type, van.spec.costs.per_task_hour
