"""Base routes of a fleet without platooning: a vehicle routing problem for PyVRP.

Least energy, with loads and time windows.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import Ways
from dispatcher_daemon.planning.routes.parts import (
    FleetPart,
    are_full,
    by_carrier,
    parts_of_routes,
    parts_of_stops,
    unserved,
)
from dispatcher_daemon.planning.routes.pyvrp_model import StopsByVehicle, VrpModel
from dispatcher_daemon.planning.routes.pyvrp_search import (
    HIGH_PENALTIES,
    Found,
    SearchAttempt,
    Searched,
    SearchJob,
    low_penalties,
    search_in_turn,
    search_within,
)
from dispatcher_daemon.settings import SearchSettings
from dispatcher_daemon.solvers.workers import TimedExecutor
from slipstream.service.tracing import traced

log = logging.getLogger(__name__)

_WHOLE_STOPS: Final = 1000
"""Up to so many stops the first search is of all at once."""
_FIRST_PARTS: Final = 2
"""How many times as many stops as a round's the parts of a first search have."""
_WHOLE_ROUNDS: Final = 5
"""Rounds in one, where a city is one part."""
_WHOLE_TIMES: Final = 1.6
"""How many times the iterations of those rounds it has: nothing is searched in parallel but seeds,
so that there is time for more."""
_DEEP_ROUNDS: Final = 2
"""Rounds in one in the second half: small steps in many cuts find little more by then."""
_SEED_STEP: Final = 1_000_003
"""Between searches of one part side by side; rounds count their seeds by ones."""
_MIN_PART_S: Final = 3.0
"""Where time is short, fewer rounds: in less a search hardly gets beyond its start."""
_FIRST_SHARE: Final = 1 / 8
"""Of the time, for each attempt at first routes."""
_LATE_S: Final = 10.0
"""Beyond its time for which a search is awaited: a worker may have to start. One whose worker was
killed as it took it on is never answered."""


@dataclass(frozen=True)
class BaseRoutes:
    """Routes without platooning.

    Attributes:
        stops: by vehicle, those it serves in order; none for a vehicle that stays idle.
        timed_out: whether time ended the search, so that a repetition may give other routes.
    """

    stops: StopsByVehicle
    unassigned: tuple[str, ...]
    timed_out: bool


@traced("base routes")
def base_routes(
    problem: RoutingProblem,
    travel: Ways,
    stops: Sequence[str],
    settings: SearchSettings,
    executor: Executor,
    seed: int,
    start: Mapping[str, Sequence[str]] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> BaseRoutes:
    """Routes of least cost over the given stops, by `Ways.search_cost_kwh`.

    A first search over the whole city is short. After it, each round cuts the routes into parts by
    location, in another direction each time, and searches the parts in parallel. Most of the gain
    comes from there: an iteration's time grows with the number of stops in it. If not all
    stops fit, as many as possible are served.

    Args:
        stops: ids; a vehicle whose first stop is not among them stays idle.
        executor: for the parts; processes, as PyVRP keeps the interpreter lock.
        seed: same seed, same routes, unless time runs out.
        start: routes to start from, by vehicle, instead of a first search.
    """
    has_vehicle = any(v.first_stop is None or v.first_stop in stops for v in problem.fleet.vehicles)
    routes: StopsByVehicle = {v.id: () for v in problem.fleet.vehicles}
    if not stops or not has_vehicle:
        return BaseRoutes(routes, tuple(stops), False)
    search = _Search(problem, travel, stops, settings, executor, clock)
    groups, anybodys = by_carrier(problem.fleet, stops)
    carriers, timed_out = groups, False
    if anybodys:
        # Among several carriers a search finds feasible routes late, unless it begins with some.
        if start is None and groups:
            found, timed_out = search.first(groups, seed, None)
            start = routes | found
        groups = [FleetPart(problem.fleet.vehicles, stops)]
        carriers = carriers or groups
    found, cut = search.first(groups, seed, start)
    routes |= found
    timed_out |= cut
    number = 0
    while number < settings.rounds:
        left_s = search.ends - clock()
        if left_s <= 0:
            timed_out = True
            break
        parts = [
            part
            for group in (carriers if anybodys and number % 2 == 0 else groups)
            for part in parts_of_routes(problem, group, routes, settings.part_stops, number)
            if part.stops
        ]
        # Where nothing is cut, a round differs from the last one by nothing but its start.
        uncut = not anybodys and len(parts) <= len(groups)
        deep = not uncut and settings.rounds / 2 <= number <= settings.rounds - _DEEP_ROUNDS
        together = _DEEP_ROUNDS if deep else 1
        if uncut:
            together = min(_WHOLE_ROUNDS, settings.rounds - number)
        limit_s = left_s * together / (settings.rounds - number)
        at_least_s = _MIN_PART_S * math.ceil(len(parts) / settings.workers)
        limit_s = min(left_s, max(limit_s, at_least_s))
        unassigned = set(unserved(stops, routes))
        times = _WHOLE_TIMES * together if uncut else together
        found, cut = search.round(
            parts, unassigned, routes, limit_s, seed + number, times, deep=deep
        )
        routes |= found
        timed_out |= cut
        number += together
    return BaseRoutes(routes, unserved(stops, routes), timed_out)


class _Search:
    """Searches of parts of one problem.

    Attributes:
        ends: when they have to be done, by the clock.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        travel: Ways,
        stops: Sequence[str],
        settings: SearchSettings,
        executor: Executor,
        clock: Callable[[], float],
    ) -> None:
        self._problem, self._travel = problem, travel
        self._settings, self._executor = settings, executor
        # Whoever serves many stops with few vehicles fills those, however many others stay idle;
        # more than can be searched at once were not measured with it.
        in_parts = settings.part_stops < len(stops) <= _WHOLE_STOPS
        full = in_parts or are_full(problem.fleet, stops)
        demand = sum(problem.fleet.stop_by_id[stop].demand for stop in stops)
        self._penalties = low_penalties(settings, demand / max(1, len(stops)), full=full)
        self.ends = clock() + settings.time_limit_s

    def first(
        self, groups: Sequence[FleetPart], seed: int, start: Mapping[str, Sequence[str]] | None
    ) -> tuple[StopsByVehicle, bool]:
        """(first feasible routes, whether time ran out); of many stops part by part, as the search
        for feasible routes takes more than twice as long for twice as many stops.
        """
        problem, settings = self._problem, self._settings
        limit_s = _FIRST_SHARE * settings.time_limit_s
        most, parts = _FIRST_PARTS * settings.part_stops, list[FleetPart]()
        for group in groups:
            if len(group.stops) <= _WHOLE_STOPS:
                parts.append(group)
            elif start is None:
                parts += parts_of_stops(problem, group, most, seed)
            else:
                known = _known(problem, group.stops, start)
                parts += parts_of_routes(problem, group, known, most, 0)
        parts = [part for part in parts if part.stops]
        models = [VrpModel(problem, self._travel, part.vehicles, part.stops) for part in parts]
        each_s = self._each(limit_s, len(parts))
        jobs = ((model, self._first_job(model, start, each_s, seed)) for model in models)
        # Without first routes there is no plan at all, whatever becomes of the workers.
        return self._side_by_side(jobs, limit_s, make_up=len(models) == 1)

    def _first_job(
        self, model: VrpModel, start: Mapping[str, Sequence[str]] | None, limit_s: float, seed: int
    ) -> SearchJob:
        """All stops by low penalties, then by high ones; at last as many stops as possible."""
        most = self._settings.iterations_to_feasible
        attempts: list[SearchAttempt] = []
        if not model.demand_exceeds_capacity():
            data = model.data(required=True)
            # Rounds improve more from routes that low penalties found.
            penalties = self._penalties, HIGH_PENALTIES
            attempts += [SearchAttempt(data, penalty, most, first=True) for penalty in penalties]
        attempts.append(SearchAttempt(model.data(required=False), HIGH_PENALTIES, most, first=True))
        return SearchJob(attempts, None if start is None else model.visits(start), limit_s, seed)

    def round(
        self,
        parts: Sequence[FleetPart],
        unassigned: AbstractSet[str],
        routes: StopsByVehicle,
        limit_s: float,
        seed: int,
        times: float,
        *,
        deep: bool = False,
    ) -> tuple[StopsByVehicle, bool]:
        """(routes of parts that were searched from given ones, whether time ran out).

        A long search of fewer parts than there are workers runs with several seeds side by side.

        Args:
            limit_s: for all parts together.
            times: how many rounds' iterations it has.
        """
        jobs = []
        most = times * self._settings.iterations_per_stop
        each_s = self._each(limit_s, len(parts))
        for part in parts:
            model = VrpModel(self._problem, self._travel, part.vehicles, part.stops)
            required = unassigned.isdisjoint(part.stops)
            attempt = SearchAttempt(
                model.data(required),
                self._penalties if required else HIGH_PENALTIES,
                round(most * max(1, len(part.stops))),
                deep=deep,
            )
            seeds = self._settings.workers // len(parts) if attempt.is_long else 1
            jobs += [
                (model, SearchJob([attempt], model.visits(routes), each_s, seed + _SEED_STEP * i))
                for i in range(max(1, seeds))
            ]
        return self._side_by_side(jobs, limit_s)

    def _each(self, limit_s: float, parts: int) -> float:
        return limit_s / math.ceil(parts / self._settings.workers)

    def _side_by_side(
        self, jobs: Iterable[tuple[VrpModel, SearchJob]], limit_s: float, *, make_up: bool = False
    ) -> tuple[StopsByVehicle, bool]:
        """The cheapest routes of each model, whether time ran out.

        Args:
            limit_s: of one attempt, for all jobs together.
            make_up: whether this process does what a worker failed at.
        """
        running = [(model, job, _submit(self._executor, job, limit_s)) for model, job in jobs]
        most_s = limit_s * max((len(job.attempts) for _, job, _ in running), default=0) + _LATE_S
        ends = time.monotonic() + most_s
        best: dict[VrpModel, Found] = {}
        timed_out = False
        for model, job, future in running:
            try:
                searched = future.result(max(0.0, ends - time.monotonic()))
            except Exception as error:
                # A worker that died costs its part one round.
                future.cancel()
                what = str(error) or f"no answer within {most_s:.0f} s"
                log.warning("part of the search failed: %s: %s", type(error).__name__, what)
                searched = search_in_turn(job) if make_up else Searched(None, True, ())
            timed_out |= searched.cut
            found = searched.found
            if found is not None and (model not in best or found.cost < best[model].cost):
                best[model] = found
        routes: StopsByVehicle = {}
        for model, found in best.items():
            routes |= model.read(found.visits)
        return routes, timed_out


def _known(
    problem: RoutingProblem, stops: Sequence[str], routes: Mapping[str, Sequence[str]]
) -> StopsByVehicle:
    """Given routes without stops that are not asked for, first stops where they belong."""
    asked = set(stops)
    firsts = {v.first_stop for v in problem.fleet.vehicles}
    known: StopsByVehicle = {}
    for vehicle in problem.fleet.vehicles:
        first = (vehicle.first_stop,) if vehicle.first_stop in asked else ()
        pooled = [s for s in routes.get(vehicle.id, ()) if s in asked and s not in firsts]
        asked.difference_update(pooled)
        known[vehicle.id] = (*first, *pooled)
    return known


def _submit(executor: Executor, job: SearchJob, limit_s: float) -> Future[Searched]:
    """A search on an executor; what keeps it from being taken on is raised with its result."""
    try:
        if isinstance(executor, TimedExecutor):
            within_s = limit_s * len(job.attempts)
            return executor.submit_within(within_s, job.total_s, search_within, job)
        return executor.submit(search_in_turn, job)
    except Exception as error:
        refused: Future[Searched] = Future()
        refused.set_exception(error)
        return refused
