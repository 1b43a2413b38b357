"""Routes as VROOM answers them: whole seconds, metres and costs, rounded down as it does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dispatcher_daemon.service.vroom.model import PER_SECOND, VroomPause, VroomProblem, VroomVisit
from dispatcher_daemon.service.vroom.timing import Step, Timetable

Violations = dict[str, int | None]
"""Seconds by cause; None where a cause has none."""
Json = dict[str, Any]

_SUMMED = ("cost", "setup", "service", "duration", "waiting_time", "priority")


def response(
    problem: VroomProblem,
    routes: Sequence[Timetable],
    unassigned: Mapping[int, str],
    violations: Mapping[int, Sequence[Violations]] | None = None,
    geometries: Mapping[int, str] | None = None,
) -> Json:
    """The answer of code 0.

    Args:
        unassigned: reason by number of each task that is on no route.
        geometries: encoded polylines by number of the vehicle; None: not asked for.
    """
    rows = [_route(problem, route, violations or {}, geometries) for route in routes]
    summary: Json = {"routes": len(rows), "unassigned": len(unassigned)}
    summary |= {name: sum(row[name] for row in rows) for name in _SUMMED}
    if problem.amounts:
        for name in ("delivery", "amount", "pickup"):
            columns = [row[name] for row in rows] or [[0] * problem.amounts]
            summary[name] = [sum(column) for column in zip(*columns, strict=True)]
    if problem.has_distances:
        summary["distance"] = sum(row["distance"] for row in rows)
    summary["violations"] = _merged(row["violations"] for row in rows)
    return {
        "code": 0,
        "summary": summary,
        "unassigned": [
            {**_named(problem, problem.tasks[number]), "reason": reason}
            for number, reason in sorted(unassigned.items())
        ],
        "routes": rows,
    }


def _route(
    problem: VroomProblem,
    route: Timetable,
    violations: Mapping[int, Sequence[Violations]],
    geometries: Mapping[int, str] | None,
) -> Json:
    van, tasks = route.van, route.tasks
    of_steps = violations.get(van.number) or [{} for _ in (*route.steps, route)]
    steps = _steps(problem, route, of_steps)
    row: Json = {"vehicle": van.spec.id, "cost": route.cost}
    if van.spec.description:
        row["description"] = van.spec.description
    row |= {name: sum(step[name] for step in steps) for name in ("setup", "service")}
    row["duration"] = steps[-1]["duration"]
    row["waiting_time"] = sum(step["waiting_time"] for step in steps)
    row["priority"] = sum(task.priority for task in tasks)
    if problem.amounts:
        sums = {
            name: [sum(column) for column in zip(*(getattr(t, name) for t in tasks), strict=True)]
            for name in ("delivery", "pickup")
        }
        row |= {
            name: sums[of] or [0] * problem.amounts
            for name, of in (("delivery", "delivery"), ("amount", "delivery"), ("pickup", "pickup"))
        }
    if problem.has_distances:
        row["distance"] = steps[-1]["distance"]
    row["steps"] = steps
    row["violations"] = _merged([*(step["violations"] for step in steps), _listed(of_steps[-1])])
    if geometries is not None:
        row["geometry"] = geometries[van.number]
    return row


def _steps(problem: VroomProblem, route: Timetable, violations: Sequence[Violations]) -> list[Json]:
    """Travel is what is left between rounded times, so that all of a route adds up."""
    rows, travelled = [], 0
    over = route.steps[0].arrival // PER_SECOND
    for number, (step, wrong) in enumerate(zip(route.steps, violations, strict=False)):
        arrival, begin = step.arrival // PER_SECOND, step.begin // PER_SECOND
        travelled += arrival - over
        setup, service = step.setup // PER_SECOND, step.service // PER_SECOND
        over = begin + setup + service
        row: Json = _place(problem, route, step, number)
        row |= {
            "arrival": arrival,
            "duration": travelled,
            "setup": setup,
            "service": service,
            "waiting_time": begin - arrival,
            "violations": _listed(wrong),
        }
        if problem.amounts:
            row["load"] = list(step.load)
        if step.metres is not None and problem.has_distances:
            row["distance"] = step.metres
        rows.append(row)
    return rows


def _place(problem: VroomProblem, route: Timetable, step: Step, number: int) -> Json:
    if isinstance(step.of, VroomPause):
        named: Json = {"type": "break", "id": step.of.spec.id}
        if step.of.spec.description:
            named["description"] = step.of.spec.description
        return named
    if isinstance(step.of, VroomVisit):
        named = _named(problem, step.of)
        return {**named, "job": named["id"]}
    spec, tasks = route.van.spec, route.tasks
    begins = number == 0
    row = route.van.start if begins else route.van.end
    index = spec.start_index if begins else spec.end_index
    if row is None and tasks:
        task = tasks[0] if begins else tasks[-1]
        row, index = task.place, task.step.location_index
        coordinates = task.step.location
    else:
        coordinates = spec.start if begins else spec.end
    return {"type": "start" if begins else "end", **_located(coordinates, index)}


def _named(problem: VroomProblem, task: VroomVisit) -> Json:
    step = task.step
    row: Json = {"type": task.kind, "id": step.id}
    if step.description:
        row["description"] = step.description
    return row | _located(step.location, step.location_index)


def _located(coordinates: tuple[float, float] | None, index: int | None) -> Json:
    row: Json = {}
    if coordinates is not None:
        row["location"] = list(coordinates)
    if index is not None:
        row["location_index"] = index
    return row


def _listed(violations: Violations) -> list[Json]:
    return [
        {"cause": cause} if seconds is None else {"cause": cause, "duration": seconds}
        for cause, seconds in violations.items()
    ]


def _merged(several: Any) -> list[Json]:
    """Violations of one cause together."""
    found: Violations = {}
    for of_one in several:
        for row in of_one:
            known, seconds = found.get(row["cause"]), row.get("duration")
            found[row["cause"]] = None if seconds is None else seconds + (known or 0)
    return _listed(found)
