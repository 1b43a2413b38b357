"""A problem in PyVRP's terms, and its routes back.

Breaks, limits of travel time and distance beside other costs, and several windows of a shipment are
left out or widened here; `repair` keeps them afterwards.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, Final

import pyvrp

from dispatcher_daemon.service.vroom.model import COST_UNITS, FOREVER, Van, VroomProblem, VroomVisit
from dispatcher_daemon.service.vroom.routes.vrp_ways import VrpWays
from dispatcher_daemon.service.vroom.timing import Timetable

Routes = dict[int, list[VroomVisit]]
"""Tasks in order, by number of the vehicle."""

_UNITS: Final = 100
"""Of a task that needs skills: penalties count by unit."""


class VrpData:
    """Translation of a problem's tasks to PyVRP and back."""

    def __init__(self, problem: VroomProblem, tasks: Sequence[VroomVisit]) -> None:
        """Take some of a problem's tasks; shipments whole."""
        self._jobs = [task for task in tasks if task.kind == "job"]
        self._shipments = [
            (task, problem.tasks[task.partner])
            for task in tasks
            if task.kind == "pickup" and task.partner is not None
        ]
        self._problem = problem
        kinds: dict[object, list[Van]] = defaultdict(list)
        for van in problem.vans:
            kinds[van.kind].append(van)
        self._kinds = list(kinds.values())
        steps = [*self._jobs, *(step for pair in self._shipments for step in pair)]
        self._steps = steps
        self._ways = VrpWays(problem.vans, steps)
        needed = dict.fromkeys(task.skills for task in steps)
        self._skills = [s for s in needed if any(not s <= van.skills for van in problem.vans)]
        self._counted = any(van.spec.max_tasks is not None for van in problem.vans)
        self._zero = self._earliest_useful()
        self._client: dict[int, int] = {}
        self._first_client: dict[int, int] = {}

    def data(self, required: bool) -> pyvrp.ProblemData:
        """The problem.

        Args:
            required: every task is served; else each has a prize, by its priority.
        """
        clients: list[pyvrp.Client] = []
        groups: list[pyvrp.ClientGroup] = []
        self._client.clear()
        for number, task in enumerate(self._jobs):
            several = len(task.windows) > 1
            group = pyvrp.ClientGroup([], required) if several else None
            self._first_client[task.number] = len(clients)
            for window in task.windows:
                self._client[len(clients)] = number
                if group is not None:
                    group.add_client(len(clients))
                clients.append(
                    pyvrp.Client(
                        location=self._ways.location[task.number],
                        delivery=[*task.delivery, *self._marks(task)],
                        pickup=[*task.pickup, *(0 for _ in self._marks(task))],
                        service_duration=self._ways.service(task),
                        **self._window(window),
                        required=required and not several,
                        prize=0 if required else self._prize(task),
                        group=len(groups) if several else None,
                    )
                )
            if group is not None:
                groups.append(group)
        return pyvrp.ProblemData(
            locations=[pyvrp.Location(0, 0)] * (len(self._ways.depots) + len(self._steps)),
            clients=clients,
            depots=[pyvrp.Depot(location=i) for i in range(len(self._ways.depots))],
            vehicle_types=[self._vehicle_type(of[0], len(of)) for of in self._kinds],
            distance_matrices=self._ways.costs(),
            duration_matrices=self._ways.times(),
            groups=groups,
            shipments=[self._shipment(*pair, required) for pair in self._shipments],
        )

    def solution(self, data: pyvrp.ProblemData, routes: Sequence[Timetable]) -> pyvrp.Solution:
        """Given sound routes of these tasks in PyVRP's terms.

        Args:
            data: what `data` gave last.
        """
        pair = {first.number: i for i, (first, _) in enumerate(self._shipments)}
        kind_of = {van.number: kind for kind, vans in enumerate(self._kinds) for van in vans}
        found = []
        for route in routes:
            acts = []
            for step in route.steps:
                task = step.of
                if not isinstance(task, VroomVisit):
                    continue
                if task.kind == "job":
                    window = next(i for i, w in enumerate(task.windows) if step.begin <= w[1])
                    client = self._first_client[task.number] + window
                    acts.append(pyvrp.Activity(pyvrp.ActivityType.CLIENT, client))
                elif task.kind == "pickup":
                    acts.append(pyvrp.Activity(pyvrp.ActivityType.PICKUP, pair[task.number]))
                elif task.partner is not None:
                    acts.append(pyvrp.Activity(pyvrp.ActivityType.DELIVERY, pair[task.partner]))
            found.append(pyvrp.Route(data, acts, kind_of[route.van.number]))
        return pyvrp.Solution(data, found)

    def read(self, solution: pyvrp.Solution) -> Routes:
        """Routes by vehicle; those of equal vehicles are assigned in order."""
        waiting: dict[int, list[list[VroomVisit]]] = defaultdict(list)
        for route in solution.routes():
            tasks = []
            for activity in route:
                if activity.is_client():
                    tasks.append(self._jobs[self._client[activity.idx]])
                elif activity.is_shipment():
                    tasks.append(self._shipments[activity.idx][activity.is_delivery()])
            waiting[route.vehicle_type()].append(tasks)
        routes: Routes = {}
        for kind, vans in enumerate(self._kinds):
            own = sorted(waiting[kind], key=lambda tasks: tasks[0].number)
            routes |= {van.number: tasks for van, tasks in zip(vans, own, strict=False)}
        return routes

    def _marks(self, task: VroomVisit) -> list[int]:
        """What a task takes of `max_tasks`, and of what only vehicles with its skills have."""
        counted = [1] if self._counted else []
        return [*counted, *(_UNITS * (task.skills == skills) for skills in self._skills)]

    def _limits(self, van: Van) -> list[int]:
        most = van.spec.max_tasks
        tasks = len(self._steps)
        counted = [tasks if most is None else min(most, tasks)] if self._counted else []
        return [*counted, *(_UNITS * tasks * (s <= van.skills) for s in self._skills)]

    def _shipment(self, first: VroomVisit, last: VroomVisit, required: bool) -> pyvrp.Shipment:
        hull = [(task.windows[0][0], max(end for _, end in task.windows)) for task in (first, last)]
        steps: dict[str, Any] = {
            f"{name}_{key}": value
            for name, task, window in zip(("pickup", "delivery"), (first, last), hull, strict=True)
            for key, value in {
                "location": self._ways.location[task.number],
                "service_duration": self._ways.service(task),
                **self._window(window),
            }.items()
        }
        marks = [0, *self._marks(first)[1:]] if self._counted else self._marks(first)
        prize = 0 if required else self._prize(first) + self._prize(last)
        return pyvrp.Shipment(
            **steps, amount=[*first.pickup, *marks], required=required, prize=prize
        )

    def _vehicle_type(self, van: Van, number: int) -> pyvrp.VehicleType:
        early, late = (self._time(moment) for moment in van.window)
        limited: dict[str, Any] = {} if late is None else {"tw_late": late}
        longest = self._longest(van)
        if longest is not None:
            limited["max_distance"] = longest
        return pyvrp.VehicleType(
            num_available=number,
            capacity=[*van.spec.capacity, *self._limits(van)],
            start_depot=self._ways.depots.index(van.start),
            end_depot=self._ways.depots.index(van.end),
            fixed_cost=van.spec.costs.fixed * COST_UNITS // self._ways.unit,
            tw_early=early or 0,
            profile=self._ways.profile(van),
            **limited,
        )

    def _longest(self, van: Van) -> int | None:
        """A limit of travel time or distance as one of cost, where ways cost nothing else."""
        costs, spec = van.spec.costs, van.spec
        given = self._problem.by_profile[spec.profile].costs is not None
        per_hour = 3600 if costs.per_hour is None else costs.per_hour
        if given or costs.per_task_hour:
            return None
        if spec.max_travel_time is not None and per_hour and not costs.per_km:
            return 100 * spec.max_travel_time * per_hour // self._ways.unit
        if spec.max_distance is not None and costs.per_km and not per_hour:
            return COST_UNITS // 1000 * costs.per_km * spec.max_distance // self._ways.unit
        return None

    def _window(self, window: tuple[int, int]) -> dict[str, Any]:
        early, late = (self._time(moment) for moment in window)
        return {"tw_early": early or 0} | ({} if late is None else {"tw_late": late})

    def _time(self, moment: int) -> int | None:
        return None if moment >= FOREVER else max(0, moment - self._zero)

    def _earliest_useful(self) -> int:
        """Times count from here: of absolute times the penalties would leave PyVRP's range."""
        begins = [
            window[0]
            for windows in [
                *(t.windows for t in self._steps),
                *((v.window,) for v in self._problem.vans),
            ]
            for window in windows
            if window[0] > 0
        ]
        return max(0, min(begins, default=0) - self._ways.whole_work())

    def _prize(self, task: VroomVisit) -> int:
        """More than any detour; a point of priority is more than all tasks without."""
        return self._ways.detour * (1 + task.priority * (len(self._steps) + 1))
