"""VROOM's plan mode: times for described routes that break time windows as little as possible.

A mixed-integer programme for each route, in two steps: the least sum of being early and late, then
with that the earliest end, the latest start for it, and everything between as early as possible.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from dispatcher_daemon.vroom.given_routes import GivenRoute, described
from dispatcher_daemon.vroom.model import (
    FOREVER,
    NO_WAY,
    PER_SECOND,
    Pause,
    Problem,
    Task,
    Windows,
)
from dispatcher_daemon.vroom.response import Violations
from dispatcher_daemon.vroom.schema import VehicleStep
from dispatcher_daemon.vroom.timing import (
    Step,
    Timetable,
    actions,
    legs,
    loads,
    travels,
    user_cost,
)
from slipstream.errors import InputError

_END_WEIGHT = 10.0
_START_WEIGHT = 5.0
_MIN_S = 0.1
_TIME_LIMIT = 1
"""Status of a search that time ended."""


def chosen_times(
    problem: Problem, ends: float, source: str
) -> tuple[list[Timetable], dict[int, list[Violations]]]:
    """(all described routes, by number of the vehicle what each step breaks, and the route's own
    last).

    Args:
        ends: when to be done, by the monotonic clock.

    Raises:
        InputError: a route that cannot be driven, hard times of steps that contradict each other,
            or none found in time; see also `described`.
    """
    routes, violations = [], {}
    for given in described(problem, source):
        if not given.tasks:
            continue
        key = f"vehicles.{given.van.spec.id}.steps"
        driven = travels(given.van, given.tasks)
        if max(driven) >= NO_WAY:
            names = ["its start", *(task.key for task in given.tasks), "its end"]
            missing = driven.index(max(driven))
            problem_text = f"no way leads from {names[missing]} to {names[missing + 1]}"
            raise InputError(source, problem_text, "change the order of the steps", key=key)
        try:
            begins = _begins(given, ends)
        except TimeoutError:
            problem_text = "no times found before the deadline"
            raise InputError(source, problem_text, "give more time", key=key) from None
        if begins is None:
            mend = "mend service_at, service_after or service_before"
            raise InputError(source, "no times meet these constraints", mend, key=key)
        route = _timed(given, begins)
        routes.append(route)
        violations[given.van.number] = _violations(problem, route)
    return routes, violations


@dataclass
class _Programme:
    """Rows of a mixed-integer programme; columns are made by `column`."""

    bounds: list[tuple[float, float]] = field(default_factory=list)
    binary: list[bool] = field(default_factory=list)
    rows: list[tuple[dict[int, float], float]] = field(default_factory=list)

    def column(self, low: float = 0.0, high: float = np.inf, *, binary: bool = False) -> int:
        """Number of a new variable."""
        self.bounds.append((low, high))
        self.binary.append(binary)
        return len(self.bounds) - 1

    def at_least(self, terms: dict[int, float], low: float) -> None:
        """Add the row Σ terms ≥ low."""
        self.rows.append((terms, low))

    def solve(self, costs: dict[int, float], ends: float) -> list[float] | None:
        """The best values; None: there are none.

        Raises:
            TimeoutError: none were found in time.
        """
        objective = np.zeros(len(self.bounds))
        for column, cost in costs.items():
            objective[column] = cost
        entries = [(i, j, v) for i, (terms, _) in enumerate(self.rows) for j, v in terms.items()]
        i, j, v = zip(*entries, strict=True)
        shape = (len(self.rows), len(self.bounds))
        low, high = zip(*self.bounds, strict=True)
        found = milp(
            objective,
            integrality=np.array(self.binary, dtype=int),
            bounds=Bounds(np.array(low), np.array(high)),
            constraints=LinearConstraint(
                coo_array((v, (i, j)), shape=shape).tocsc(), [at for _, at in self.rows], np.inf
            ),
            options={"time_limit": max(_MIN_S, ends - time.monotonic())},
        )
        if found.x is None and found.status == _TIME_LIMIT:
            raise TimeoutError
        return None if found.x is None else [float(x) for x in found.x]


def _begins(given: GivenRoute, ends: float) -> list[int] | None:
    """When each step begins, hundredths of a second; None: hard times contradict each other."""
    van, tasks = given.van, given.tasks
    whole: Windows = (van.window,)
    windows = [whole if one is None else one.windows for one in given.of]
    finite = [moment for of in windows for w in of for moment in w if moment < FOREVER] + [
        PER_SECOND * s for step in given.steps for s in _hard(step) if s is not None
    ]
    driven, worked = travels(van, tasks), actions(van, tasks)
    drive = sum(driven) + sum(map(sum, worked)) + sum(p.service for p in van.pauses)
    # Large absolute times would leave the tolerances of the search no digits.
    zero = max(0, min(finite, default=0) - drive)
    far = float(max(finite, default=0) - zero + 2 * drive + 1)
    programme = _Programme()
    times, outside = [], []
    for step, of in zip(given.steps, windows, strict=True):
        at, after, before = _hard(step)
        low = max((PER_SECOND * s - zero for s in (at, after) if s is not None), default=0)
        high = min((PER_SECOND * s - zero for s in (at, before) if s is not None), default=far)
        if high < max(low, 0):
            return None
        begin = programme.column(max(low, 0), high)
        early, late = programme.column(), programme.column()
        chosen = [programme.column(0, 1, binary=True) for _ in of] if len(of) > 1 else []
        if chosen:
            programme.at_least(dict.fromkeys(chosen, 1.0), 1.0)
            programme.at_least(dict.fromkeys(chosen, -1.0), -1.0)
        for number, (start, end) in enumerate(of):
            slack = {chosen[number]: -far} if chosen else {}
            by = far if chosen else 0.0
            programme.at_least({begin: 1, early: 1, **slack}, max(0, start - zero) - by)
            if end < FOREVER:
                programme.at_least({begin: -1, late: 1, **slack}, zero - end - by)
        times.append(begin)
        outside += [early, late]
    places = [n for n, one in enumerate(given.of) if not isinstance(one, Pause)]
    durations = [0, *(sum(one) for one in worked)]
    for number, (a, b) in enumerate(pairwise(places)):
        between = range(a + 1, b)
        pauses = [one.service for one in given.of[a + 1 : b] if isinstance(one, Pause)]
        whole_s = durations[number] + driven[number] + sum(pauses)
        programme.at_least({times[b]: 1, times[a]: -1}, whole_s)
        lasts = [durations[number], *pauses]
        for (n, m), duration in zip(pairwise([a, *between, b]), lasts, strict=True):
            programme.at_least({times[m]: 1, times[n]: -1}, duration)
    first = programme.solve(dict.fromkeys(outside, 1.0), ends)
    if first is None:
        return None
    least = round(sum(first[column] for column in outside))
    programme.at_least(dict.fromkeys(outside, -1.0), -float(least))
    soon = dict.fromkeys(times, 1.0 / len(times))
    weights = {times[-1]: _END_WEIGHT, times[0]: -_START_WEIGHT}
    try:
        best = programme.solve(soon | weights, ends)
    except TimeoutError:
        best = None
    found = first if best is None else best
    return [round(found[begin]) + zero for begin in times]


def _hard(step: VehicleStep) -> tuple[int | None, int | None, int | None]:
    return step.service_at, step.service_after, step.service_before


def _timed(given: GivenRoute, begins: Sequence[int]) -> Timetable:
    """The route with its times; travel comes before breaks as far as there is time."""
    van, tasks = given.van, given.tasks
    driven, worked, at = (
        travels(van, tasks),
        actions(van, tasks),
        loads(tasks, len(van.spec.capacity)),
    )
    distance, ways = van.ways.distance, legs(van, tasks)
    steps: list[Step] = []
    over, left, travelled, number = begins[0], driven[0], 0, 0
    metres = None if distance is None else 0
    for one, begin in zip(given.of, begins, strict=True):
        if not steps:
            steps.append(Step(None, begin, begin, 0, 0, 0, metres, at[0]))
            continue
        share = min(left, begin - over) if isinstance(one, Pause) else left
        arrival, left, travelled = over + share, left - share, travelled + share
        setup = service = 0
        if isinstance(one, Pause):
            service = one.service
        else:
            leg = ways[number]
            if metres is not None and distance is not None and leg is not None:
                metres += distance[leg[0]][leg[1]]
            if one is not None:
                setup, service = worked[number]
                number += 1
                left = driven[number]
        steps.append(Step(one, arrival, begin, setup, service, travelled, metres, at[number]))
        over = begin + setup + service
    return Timetable(van, tuple(tasks), tuple(steps), user_cost(van, tasks))


def _violations(problem: Problem, route: Timetable) -> list[Violations]:
    """What each step breaks, and what only the whole route does last."""
    van, spec = route.van, route.van.spec
    present = {task.number for task in route.tasks}
    seen: set[int] = set()
    found: list[Violations] = []
    for step in route.steps:
        wrong: Violations = {}
        one = step.of
        _add_times(wrong, step, (van.window,) if one is None else one.windows)
        if any(a > b for a, b in zip(step.load, spec.capacity, strict=True)):
            wrong["load"] = None
        if isinstance(one, Task):
            seen.add(one.number)
            if not one.skills <= van.skills:
                wrong["skills"] = None
            if spec.max_tasks is not None and len(seen) > spec.max_tasks:
                wrong["max_tasks"] = None
            apart = one.partner is not None and one.partner not in present
            early = one.kind == "delivery" and one.partner not in seen
            late = one.kind == "pickup" and one.partner in seen
            if apart or early or late:
                wrong["precedence"] = None
        limit = spec.max_travel_time
        if limit is not None and step.travelled > PER_SECOND * limit:
            wrong["max_travel_time"] = None
        if spec.max_distance is not None and (step.metres or 0) > spec.max_distance:
            wrong["max_distance"] = None
        if isinstance(one, Pause) and not one.fits(step.load):
            wrong["max_load"] = None
        found.append(wrong)
    taken = {id(step.of) for step in route.steps if isinstance(step.of, Pause)}
    missing = any(id(pause) not in taken for pause in van.pauses)
    return [*found, {"missing_break": None} if missing else {}]


def _add_times(wrong: Violations, step: Step, windows: Windows) -> None:
    """By the window that the step misses least."""

    def misses(window: tuple[int, int]) -> int:
        return max(0, window[0] - step.begin, step.begin - window[1])

    start, end = min(windows, key=misses)
    for cause, by in (("lead_time", start - step.begin), ("delay", step.begin - end)):
        if by >= PER_SECOND:
            wrong[cause] = by // PER_SECOND
