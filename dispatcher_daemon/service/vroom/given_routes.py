"""Routes that a request describes in its vehicles' `steps`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dispatcher_daemon.service.vroom.model import Van, VroomPause, VroomProblem, VroomVisit
from dispatcher_daemon.service.vroom.schema import VehicleStep
from dispatcher_daemon.service.vroom.timing import Timetable, fault, timetable
from slipstream.errors import InputError


@dataclass(frozen=True)
class GivenRoute:
    """A vehicle's described route.

    Attributes:
        steps: of type start, then those of the route, then of type end.
        of: task or break of each; None: the ends.
    """

    van: Van
    steps: tuple[VehicleStep, ...]
    of: tuple[VroomVisit | VroomPause | None, ...]

    @property
    def tasks(self) -> list[VroomVisit]:
        """Tasks in order."""
        return [one for one in self.of if isinstance(one, VroomVisit)]


def described(problem: VroomProblem, source: str) -> list[GivenRoute]:
    """The routes of all vehicles that have steps.

    Raises:
        InputError: an unknown id, a task or break twice, or a start or end amid the route.
    """
    by_id: dict[tuple[str, int | None], VroomVisit] = {
        (task.kind, task.step.id): task for task in problem.tasks
    }
    used: set[object] = set()
    found = []
    for van in problem.vans:
        steps = van.spec.steps
        if not steps:
            continue
        pauses = {pause.spec.id: pause for pause in van.pauses}
        inner = steps[steps[0].type == "start" : len(steps) - (steps[-1].type == "end")]
        of: list[VroomVisit | VroomPause | None] = []
        for step in inner:
            key = f"vehicles.{van.spec.id}.steps"
            one: VroomVisit | VroomPause | None = None
            if step.type == "break" and step.id is not None:
                one = pauses.get(step.id)
            elif step.type in ("job", "pickup", "delivery"):
                one = by_id.get((step.type, step.id))
            else:
                mend = "put start first and end last"
                raise InputError(source, f"{step.type} amid a route", mend, key=key)
            if one is None:
                problem_text = f"unknown {step.type} {step.id}"
                raise InputError(source, problem_text, "name one of the request", key=key)
            name = (van.number if step.type == "break" else None, step.type, step.id)
            if name in used:
                raise InputError(source, f"{step.type} {step.id} twice", "remove one", key=key)
            used.add(name)
            of.append(one)
        begin = steps[0] if steps[0].type == "start" else VehicleStep(type="start")
        end = steps[-1] if steps[-1].type == "end" else VehicleStep(type="end")
        found.append(GivenRoute(van, (begin, *inner, end), (None, *of, None)))
    return found


def start_routes(problem: VroomProblem, source: str) -> Sequence[Timetable]:
    """Described routes to start a search from; of their steps the tasks count.

    Raises:
        InputError: as `described`; also, a route breaks a rule.
    """
    found = []
    for route in described(problem, source):
        tasks = route.tasks
        if not tasks:
            continue
        key = f"vehicles.{route.van.spec.id}.steps"
        on_route = {task.number for task in tasks}
        apart = next(
            (t for t in tasks if t.partner is not None and t.partner not in on_route), None
        )
        if apart is not None:
            raise InputError(source, f"{apart.key} without its other step", "add it", key=key)
        wrong = fault(route.van, tasks)
        timed = timetable(route.van, tasks)
        if wrong is not None or timed is None:
            reason = "" if wrong is None else wrong.reason
            raise InputError(source, f"no valid route: {reason}", "mend or remove it", key=key)
        found.append(timed)
    return found
