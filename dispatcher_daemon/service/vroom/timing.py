"""When a vehicle is where on a route, with windows, set-up and breaks, and which rule it breaks.

A break needs no place: travel before and after it counts as one. Breaks come in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import Final

from dispatcher_daemon.service.vroom.model import (
    COST_UNITS,
    NO_WAY,
    PER_SECOND,
    Van,
    VroomPause,
    VroomVisit,
    Windows,
)

StepOf = VroomVisit | VroomPause | None
"""A task, a break, or an end of the route."""


@dataclass(frozen=True)
class Step:
    """One of a route.

    Attributes:
        arrival: hundredths of a second, as all times here.
        travelled: before it, on the whole route.
        metres: likewise; None: not known.
    """

    of: StepOf
    arrival: int
    begin: int
    setup: int
    service: int
    travelled: int
    metres: int | None
    load: tuple[int, ...]


@dataclass(frozen=True)
class Timetable:
    """A route with its times."""

    van: Van
    tasks: tuple[VroomVisit, ...]
    steps: tuple[Step, ...]
    cost: int


def actions(van: Van, tasks: Sequence[VroomVisit]) -> list[tuple[int, int]]:
    """(set-up, service) of each task: no set-up where the one before, or the start, is there."""
    found, place = [], van.start
    for task in tasks:
        setup, service = van.action(task)
        found.append((0 if task.place == place else setup, service))
        place = task.place
    return found


def legs(van: Van, tasks: Sequence[VroomVisit]) -> list[tuple[int, int] | None]:
    """(from, to) of the ways to each task and to the end; None: there is none to drive."""
    places = [van.start, *(task.place for task in tasks), van.end]
    return [None if a is None or b is None else (a, b) for a, b in pairwise(places)]


def travels(van: Van, tasks: Sequence[VroomVisit]) -> list[int]:
    """Times of the ways to each task and to the end; `NO_WAY` where no road leads."""
    duration = van.ways.duration
    return [0 if leg is None else duration[leg[0]][leg[1]] for leg in legs(van, tasks)]


def cost_of(van: Van, tasks: Sequence[VroomVisit]) -> int:
    """Internal cost of a route; none where the vehicle stays."""
    if not tasks:
        return 0
    cost, costs = van.ways.cost, van.spec.costs
    driven = sum(cost[leg[0]][leg[1]] for leg in legs(van, tasks) if leg is not None)
    worked = sum(map(sum, actions(van, tasks))) if costs.per_task_hour else 0
    return COST_UNITS * costs.fixed + driven + costs.per_task_hour * worked


def user_cost(van: Van, tasks: Sequence[VroomVisit]) -> int:
    """Cost of a route in the answer: that of travel and that of tasks are rounded down each."""
    worked = van.spec.costs.per_task_hour * sum(map(sum, actions(van, tasks)))
    fixed = COST_UNITS * van.spec.costs.fixed
    driven = cost_of(van, tasks) - worked - fixed
    return van.spec.costs.fixed + driven // COST_UNITS + worked // COST_UNITS


def loads(tasks: Sequence[VroomVisit], size: int) -> list[tuple[int, ...]]:
    """Load at the start and after each task."""
    load = [0] * size
    for task in tasks:
        if task.kind == "job":
            load = [a + b for a, b in zip(load, task.delivery, strict=True)]
    found = [tuple(load)]
    for task in tasks:
        load = [a - b + c for a, b, c in zip(load, task.delivery, task.pickup, strict=True)]
        found.append(tuple(load))
    return found


@dataclass(frozen=True, order=True)
class Fault:
    """A rule that a route breaks; the later its stage, the nearer the route is to being sound."""

    stage: int
    reason: str


NO_WAY_STAGE: Final = 4
"""Stage of a fault that is mended where other tasks lie between."""


def fault(van: Van, tasks: Sequence[VroomVisit]) -> Fault | None:
    """The first rule that a route breaks; None: none, and its times are found."""
    spec = van.spec
    if any(not task.skills <= van.skills for task in tasks):
        return Fault(0, "no vehicle has its skills")
    if spec.max_tasks is not None and len(tasks) > spec.max_tasks:
        return Fault(1, f"max_tasks ({spec.max_tasks}) would be exceeded")
    seen: set[int] = set()
    for task in tasks:
        seen.add(task.number)
        if task.kind == "delivery" and task.partner not in seen:
            return Fault(2, "the delivery would come before its pickup")
    at = loads(tasks, len(spec.capacity))
    if any(a > b for load in at for a, b in zip(load, spec.capacity, strict=True)):
        return Fault(3, "the load would be above every capacity")
    driven = travels(van, tasks)
    if max(driven) >= NO_WAY:
        return Fault(NO_WAY_STAGE, "no way leads there and back")
    if spec.max_travel_time is not None and sum(driven) > PER_SECOND * spec.max_travel_time:
        return Fault(5, f"max_travel_time ({spec.max_travel_time} s) would be exceeded")
    if spec.max_distance is not None and metres(van, tasks) > spec.max_distance:
        return Fault(6, f"max_distance ({spec.max_distance} m) would be exceeded")
    if _pauses_before(van, tasks, driven, at) is None:
        windows = "time windows and breaks" if van.pauses else "time windows"
        return Fault(7, f"the {windows} of task and vehicle cannot be kept")
    return None


def timetable(van: Van, tasks: Sequence[VroomVisit]) -> Timetable | None:
    """The earliest end of a route, with the latest start for it; None: a rule is broken."""
    if fault(van, tasks) is not None:
        return None
    driven, at = travels(van, tasks), loads(tasks, len(van.spec.capacity))
    known = _pauses_before(van, tasks, driven, at)
    if known is None:
        return None
    pauses, end = known
    begin = _latest_start(van, tasks, driven, pauses, end)
    left = iter(van.pauses)
    of: list[StepOf] = [None]
    for one, before in zip([*tasks, None], pauses, strict=True):
        of += [*islice(left, before), one]

    def soonest(number: int, one: StepOf, time: int) -> int:
        found = time if one is None else _first_from(one.windows, time)
        assert found is not None  # `_pauses_before` found it
        return found if number else begin

    return timed(van, of, soonest)


def timed(
    van: Van,
    of: Sequence[StepOf],
    when: Callable[[int, StepOf, int], int],
) -> Timetable:
    """A route with its times; travel comes before breaks as far as there is time.

    Args:
        of: the steps, its start and its end first and last.
        when: begin of a step, from its number, itself and the moment at which it can begin.
    """
    tasks = [one for one in of if isinstance(one, VroomVisit)]
    driven, worked, ways = travels(van, tasks), actions(van, tasks), legs(van, tasks)
    at, distance = loads(tasks, len(van.spec.capacity)), van.ways.distance
    driven_m = None if distance is None else 0
    over = when(0, None, 0)
    steps = [Step(None, over, over, 0, 0, 0, driven_m, at[0])]
    left, travelled, number = driven[0], 0, 0
    for one in of[1:]:
        is_pause = isinstance(one, VroomPause)
        start = when(len(steps), one, over if is_pause else over + left)
        share = min(left, start - over) if is_pause else left
        arrival, left, travelled = over + share, left - share, travelled + share
        setup = service = 0
        if isinstance(one, VroomPause):
            service = one.service
        else:
            leg = ways[number]
            if driven_m is not None and distance is not None and leg is not None:
                driven_m += distance[leg[0]][leg[1]]
            if one is not None:
                setup, service = worked[number]
                number += 1
                left = driven[number]
        steps.append(Step(one, arrival, start, setup, service, travelled, driven_m, at[number]))
        over = start + setup + service
    return Timetable(van, tuple(tasks), tuple(steps), user_cost(van, tasks))


def metres(van: Van, tasks: Sequence[VroomVisit]) -> int:
    """Distance of a route whose vehicle knows distances."""
    distance = van.ways.distance or ()
    return sum(distance[leg[0]][leg[1]] for leg in legs(van, tasks) if leg is not None)


def _first_from(windows: Windows, time: int) -> int | None:
    """The earliest moment not before a time; None: the windows are over."""
    return next((max(time, start) for start, end in windows if time <= end), None)


def _last_until(windows: Windows, time: int) -> int:
    """The latest moment not after a time; there is one where the earliest times were found."""
    return max(min(time, end) for start, end in windows if start <= time)


_Reached = dict[int, tuple[int, tuple[int, ...]]]
"""By number of breaks taken: (when, how many breaks before each task and before the end)."""


def _pauses_before(
    van: Van, tasks: Sequence[VroomVisit], driven: Sequence[int], at: Sequence[tuple[int, ...]]
) -> tuple[tuple[int, ...], int] | None:
    """(breaks before each task and before the end, the earliest end), or None.

    Of routes up to a task with as many breaks the one that is ready first is kept: whoever is
    ready earlier can do whatever another one can.
    """
    reached: _Reached = {0: (van.window[0], ())}
    ends = (((van.window[0], van.window[1]),), 0)
    jobs = [(t.windows, sum(a)) for t, a in zip(tasks, actions(van, tasks), strict=True)]
    for (windows, duration), travel, load in zip([*jobs, ends], driven, at, strict=True):
        ready: _Reached = {}
        for taken, (when, before) in reached.items():
            time, left = when, travel
            for number in range(taken, len(van.pauses) + 1):
                begin = _first_from(windows, time + left)
                known = ready.get(number)
                if begin is not None and (known is None or begin + duration < known[0]):
                    ready[number] = begin + duration, (*before, number - taken)
                if number == len(van.pauses):
                    break
                pause = van.pauses[number]
                start = _first_from(pause.windows, time)
                if start is None or not pause.fits(load):
                    break
                left -= min(left, start - time)
                time = start + pause.service
        reached = ready
    end = reached.get(len(van.pauses))
    if end is None or end[0] > van.window[1]:
        return None
    return end[1], end[0]


def _latest_start(
    van: Van, tasks: Sequence[VroomVisit], driven: Sequence[int], pauses: Sequence[int], end: int
) -> int:
    """The latest start that ends as early."""
    worked = actions(van, tasks)
    number, begin = len(van.pauses), end
    for position in range(len(tasks), -1, -1):
        left = driven[position]
        for _ in range(pauses[position]):
            number -= 1
            pause = van.pauses[number]
            over = begin - pause.service
            begin = _last_until(pause.windows, over)
            left -= min(left, over - begin)
        begin -= left
        if position > 0:
            task = tasks[position - 1]
            begin = _last_until(task.windows, begin - sum(worked[position - 1]))
    return begin
