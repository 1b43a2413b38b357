"""VROOM's plan mode: times for described routes that break time windows as little as possible.

The least sum of being early and late, then with that the earliest end, the latest start for it, and
everything between as early as possible.
"""

from __future__ import annotations

import time
from typing import Final

from dispatcher_daemon.service.vroom.given_routes import GivenRoute, described
from dispatcher_daemon.service.vroom.least_missed import MissedEvent, least_missed
from dispatcher_daemon.service.vroom.model import (
    FOREVER,
    NO_WAY,
    PER_SECOND,
    VroomPause,
    VroomProblem,
    VroomVisit,
    Windows,
)
from dispatcher_daemon.service.vroom.response import Violations
from dispatcher_daemon.service.vroom.schema import VehicleStep
from dispatcher_daemon.service.vroom.timing import (
    Step,
    Timetable,
    actions,
    timed,
    travels,
)
from slipstream.errors import InputError

_MIN_S: Final = 1.0
"""For a route, however late it is."""


def chosen_times(
    problem: VroomProblem, ends: float, source: str
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
            begins = least_missed(_events(given), max(ends, time.monotonic() + _MIN_S))
        except TimeoutError:
            problem_text = "no times found before the deadline"
            raise InputError(source, problem_text, "give more time", key=key) from None
        if begins is None:
            mend = "mend service_at, service_after or service_before"
            raise InputError(source, "no times meet these constraints", mend, key=key)
        route = timed(given.van, given.of, lambda number, *_, at=begins: at[number])
        routes.append(route)
        violations[given.van.number] = _violations(problem, route)
    return routes, violations


def _events(given: GivenRoute) -> list[MissedEvent]:
    """The steps of a route, hundredths of a second."""
    van, tasks = given.van, given.tasks
    worked, driven = iter(actions(van, tasks)), iter(travels(van, tasks))
    found = []
    for step, one in zip(given.steps, given.of, strict=True):
        at, after, before = _hard(step)
        low = max((PER_SECOND * s for s in (at, after) if s is not None), default=0)
        high = min((PER_SECOND * s for s in (at, before) if s is not None), default=FOREVER)
        if isinstance(one, VroomPause):
            found.append(MissedEvent(one.windows, low, high, one.service, None))
        elif one is None:
            found.append(MissedEvent((van.window,), low, high, 0, next(driven, 0)))
        else:
            found.append(MissedEvent(one.windows, low, high, sum(next(worked)), next(driven)))
    return found


def _hard(step: VehicleStep) -> tuple[int | None, int | None, int | None]:
    return step.service_at, step.service_after, step.service_before


def _violations(problem: VroomProblem, route: Timetable) -> list[Violations]:
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
        if isinstance(one, VroomVisit):
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
        if isinstance(one, VroomPause) and not one.fits(step.load):
            wrong["max_load"] = None
        found.append(wrong)
    taken = {id(step.of) for step in route.steps if isinstance(step.of, VroomPause)}
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
