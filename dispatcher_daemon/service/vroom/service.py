"""A request answered: the one entrance of this room, for the command line and for HTTP."""

from __future__ import annotations

import logging
import time
from typing import Final

from dispatcher_daemon.service.vroom.engine import RoadWays, RoutingEngine, RoutingError, polyline
from dispatcher_daemon.service.vroom.eta import chosen_times
from dispatcher_daemon.service.vroom.given_routes import start_routes
from dispatcher_daemon.service.vroom.matrices import with_matrices, with_roads
from dispatcher_daemon.service.vroom.model import VroomProblem
from dispatcher_daemon.service.vroom.response import Json, response
from dispatcher_daemon.service.vroom.routes import repaired, search, units_of, unservable
from dispatcher_daemon.service.vroom.schema import Request
from dispatcher_daemon.service.vroom.timing import Timetable, timetable
from dispatcher_daemon.service.vroom.unread import unread
from slipstream.config import check
from slipstream.errors import InputError

log = logging.getLogger(__name__)

INTERNAL_ERROR: Final = 1
INPUT_ERROR: Final = 2
ROUTING_ERROR: Final = 3
MAX_TASKS: Final = 2000
_SEARCH_SHARE: Final = 0.6
"""Of the time, where routes need more than the search knows."""


def solve_vroom(
    request: object,
    engine: RoutingEngine | None,
    deadline_s: float,
    seed: int,
    *,
    geometry: bool = False,
    choose_eta: bool = False,
    source: str = "request",
) -> Json:
    """The answer to a request in VROOM's format, as plain data; never an exception.

    Args:
        engine: roads for coordinates; None: only requests with matrices are answered.
        deadline_s: for the whole answer; a small request takes less.
        seed: same request, same seed, same answer, unless the deadline ends the search.
        choose_eta: VROOM's plan mode: only times are chosen, for the routes in `steps`.
    """
    ends = time.monotonic() + deadline_s
    try:
        warnings = unread(request, source)
        try:
            answer = _answer(
                check(request, Request, source), engine, ends, seed, geometry, choose_eta, source
            )
        except RoutingError as error:
            answer = _refusal(ROUTING_ERROR, error)
        except InputError as error:
            answer = _refusal(INPUT_ERROR, error)
    except Exception as error:
        log.exception("a request in VROOM's format was not answered")
        return {"code": INTERNAL_ERROR, "error": f"internal error: {type(error).__name__}"}
    return answer | {"warnings": warnings} if warnings else answer


def _refusal(code: int, error: InputError) -> Json:
    """VROOM's members, and the parts of the line by the names of our problem documents."""
    field = {} if error.key is None else {"field": error.key}
    return {
        "code": code,
        "error": str(error),
        "detail": error.problem,
        **field,
        "mend": error.mend,
    }


def _answer(
    request: Request,
    engine: RoutingEngine | None,
    ends: float,
    seed: int,
    geometry: bool,
    choose_eta: bool,
    source: str,
) -> Json:
    steps = len(request.jobs) + 2 * len(request.shipments)
    if steps > MAX_TASKS:
        raise InputError(source, f"{steps} tasks", f"give at most {MAX_TASKS}", key="jobs")
    ways: dict[str, RoadWays] | None = None
    if request.profile_matrices:
        problem = with_matrices(request, source)
        if geometry:
            mend = "leave it out, or give coordinates without matrices"
            raise InputError(source, "needs roads, not matrices", mend, key="geometry")
    elif engine is None:
        mend = "give a road network (--network), or matrices"
        raise InputError(source, "coordinates, but no roads", mend, key="matrices")
    else:
        problem, ways = with_roads(request, engine, source)
    violations = None
    if choose_eta:
        routes, violations = chosen_times(problem, ends, source)
        on_routes = {task.number for route in routes for task in route.tasks}
        missing = {
            task.number: "in no vehicle's steps"
            for task in problem.tasks
            if task.number not in on_routes
        }
    else:
        routes, missing = _solved(problem, ends, seed, source)
    geometries = None
    if geometry and ways is not None:
        geometries = {
            route.van.number: _geometry(route, ways[route.van.spec.profile]) for route in routes
        }
    return response(problem, routes, missing, violations, geometries)


def _solved(
    problem: VroomProblem, ends: float, seed: int, source: str
) -> tuple[list[Timetable], dict[int, str]]:
    """(routes with their times, reason by number of each task that is on none)."""
    start = start_routes(problem, source)
    missing = unservable(problem, units_of(problem))
    units = [unit for unit in units_of(problem) if unit[0].number not in missing]
    exact = _is_exact(problem)
    left_s = max(0.0, ends - time.monotonic())
    tasks = [task for task in problem.tasks if task.number not in missing]
    found = search(problem, tasks, left_s if exact else _SEARCH_SHARE * left_s, seed, start)
    found, left = repaired(problem, found, units, ends, seed, exact=exact)
    timed = []
    for number in sorted(found):
        route = timetable(problem.vans[number], found[number])
        assert route is not None  # `repaired` gives sound routes only
        timed.append(route)
    return timed, missing | left


def _is_exact(problem: VroomProblem) -> bool:
    """Whether PyVRP knows all rules of a request."""
    shipments = any(task.partner is not None for task in problem.tasks)
    return not any(
        van.pauses
        or van.spec.max_travel_time is not None
        or van.spec.max_distance is not None
        or (shipments and van.spec.max_tasks is not None)
        for van in problem.vans
    ) and not any(
        (task.partner is not None and len(task.windows) > 1)
        or task.step.setup
        or task.step.setup_per_type
        for task in problem.tasks
    )


def _geometry(route: Timetable, ways: RoadWays) -> str:
    rows = [
        route.van.start,
        *(task.place for task in route.tasks),
        route.van.end,
    ]
    return polyline(ways.points([row for row in rows if row is not None]))
