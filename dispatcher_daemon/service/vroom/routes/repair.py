"""Exact rules for routes that a search found by simplified ones: what breaks a rule is taken out,
what is left is inserted where it costs least, and parts are taken out and inserted anew.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dispatcher_daemon.service.vroom.model import Van, VroomProblem, VroomVisit
from dispatcher_daemon.service.vroom.routes.reach import Reach
from dispatcher_daemon.service.vroom.routes.vrp_data import Routes
from dispatcher_daemon.service.vroom.timing import NO_WAY_STAGE, Fault, cost_of, fault

Unit = tuple[VroomVisit, ...]
"""A job, or pickup and delivery of a shipment."""

_ROUNDS: Final = 200
_MAX_REMOVED: Final = 8
_NO_ROOM: Final = "every vehicle that can serve it is full, out of time or serves what counts more"
_NO_TIME: Final = "no place was found for it before the deadline"


def units_of(problem: VroomProblem) -> list[Unit]:
    """All jobs and shipments."""
    return [
        (task,) if task.partner is None else (task, problem.tasks[task.partner])
        for task in problem.tasks
        if task.kind != "delivery"
    ]


def unservable(problem: VroomProblem, units: Sequence[Unit]) -> dict[int, str]:
    """Reason by number of each task that no vehicle can serve, even alone."""
    found: dict[int, str] = {}
    vans, reach = list(_distinct(problem.vans)), Reach(problem)
    for unit in units:
        faults: list[Fault] = []
        for van in vans:
            wrong = fault(van, unit)
            if wrong is None or (wrong.stage == NO_WAY_STAGE and reach.serves(van, unit)):
                break
            faults.append(wrong)
        else:
            found |= {task.number: max(faults).reason for task in unit}
    return found


def repaired(
    problem: VroomProblem,
    routes: Routes,
    units: Sequence[Unit],
    ends: float,
    seed: int,
    *,
    exact: bool,
) -> tuple[Routes, dict[int, str]]:
    """(sound routes, reason by number of each task that is on none).

    Args:
        ends: when to be done, by the monotonic clock.
        exact: whether the search knew all rules, so that sound routes need no more search.
    """
    plan = _Plan(problem, {van.number: list(routes.get(van.number, ())) for van in problem.vans})
    loose = [unit for van in problem.vans for unit in plan.make_sound(van)]
    on_routes = {task.number for tasks in plan.routes.values() for task in tasks}
    known = {unit[0].number for unit in loose}
    loose += [u for u in units if u[0].number not in on_routes | known]
    loose = plan.insert(_by_priority(loose), ends)
    if loose or not exact:
        rng = np.random.default_rng(seed)
        for _ in range(_ROUNDS):
            if time.monotonic() >= ends:
                break
            plan, loose = _changed(plan, loose, units, rng, ends)
    why = _NO_TIME if time.monotonic() >= ends else _NO_ROOM
    return (
        {number: tasks for number, tasks in plan.routes.items() if tasks},
        {task.number: why for unit in loose for task in unit},
    )


def _changed(
    plan: _Plan,
    loose: list[Unit],
    units: Sequence[Unit],
    rng: np.random.Generator,
    ends: float,
) -> tuple[_Plan, list[Unit]]:
    """The plan with some units taken out and inserted anew, if that is no worse."""
    away = {unit[0].number for unit in loose}
    served = [unit for unit in units if unit[0].number not in away]
    if not served:
        return plan, loose
    count = int(rng.integers(1, min(_MAX_REMOVED, len(served)) + 1))
    taken = [served[i] for i in rng.permutation(len(served))[:count]]
    other = plan.without(taken)
    waiting = [*loose, *taken]
    order = [waiting[i] for i in rng.permutation(len(waiting))]
    left = other.insert(_by_priority(order) if rng.random() < 0.5 else order, ends)
    if other.rank(left) <= plan.rank(loose):
        return other, left
    return plan, loose


@dataclass
class _Plan:
    """Routes by number of the vehicle; all vehicles have one."""

    problem: VroomProblem
    routes: Routes

    def rank(self, loose: Sequence[Unit]) -> tuple[int, int, int]:
        """Less is better: priority left out, tasks left out, cost."""
        cost = sum(cost_of(self.problem.vans[n], tasks) for n, tasks in self.routes.items())
        return sum(t.priority for u in loose for t in u), sum(map(len, loose)), cost

    def without(self, units: Sequence[Unit]) -> _Plan:
        gone = {task.number for unit in units for task in unit}
        return _Plan(
            self.problem,
            {n: [t for t in tasks if t.number not in gone] for n, tasks in self.routes.items()},
        )

    def make_sound(self, van: Van) -> list[Unit]:
        """Take units out of a route until it breaks no rule; these units."""
        out: list[Unit] = []
        while self.routes[van.number] and fault(van, self.routes[van.number]) is not None:
            tasks = self.routes[van.number]
            present = {task.number for task in tasks}
            units = [
                (task,) if task.partner is None else (task, self.problem.tasks[task.partner])
                for task in tasks
                if task.kind != "delivery" or task.partner not in present
            ]
            choices = []
            for number, unit in enumerate(units):
                rest = [task for task in tasks if task not in unit]
                unsound = bool(rest) and fault(van, rest) is not None
                choices.append((unsound, unit[0].priority, cost_of(van, rest), number))
            unit = units[min(choices)[3]]
            self.routes[van.number] = [task for task in tasks if task not in unit]
            out.append(unit)
        return out

    def insert(self, units: Sequence[Unit], ends: float) -> list[Unit]:
        """Insert one after the other where it costs least; those that fit nowhere."""
        left = []
        for unit in units:
            best: tuple[int, int, list[VroomVisit]] | None = None
            idle: set[object] = set()
            for van in self.problem.vans:
                if time.monotonic() >= ends:
                    break
                tasks = self.routes[van.number]
                if not tasks:
                    if van.kind in idle:
                        continue
                    idle.add(van.kind)
                if not all(task.skills <= van.skills for task in unit):
                    continue
                before = cost_of(van, tasks)
                for longer in _insertions(tasks, unit):
                    more = cost_of(van, longer) - before
                    if (best is None or more < best[0]) and fault(van, longer) is None:
                        best = more, van.number, longer
            if best is None:
                left.append(unit)
            else:
                self.routes[best[1]] = best[2]
        return left


def _insertions(tasks: list[VroomVisit], unit: Unit) -> Iterator[list[VroomVisit]]:
    for i in range(len(tasks) + 1):
        one = [*tasks[:i], unit[0], *tasks[i:]]
        if len(unit) == 1:
            yield one
            continue
        for j in range(i + 1, len(one) + 1):
            yield [*one[:j], unit[1], *one[j:]]


def _by_priority(units: Sequence[Unit]) -> list[Unit]:
    return sorted(units, key=lambda unit: -unit[0].priority)


def _distinct(vans: Sequence[Van]) -> Iterator[Van]:
    """One vehicle of each kind."""
    yield from {van.kind: van for van in reversed(vans)}.values()
