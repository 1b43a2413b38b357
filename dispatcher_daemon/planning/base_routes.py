"""Base routes of a fleet without platooning: a vehicle routing problem for PyVRP.

Least energy, with loads and time windows.
"""

from __future__ import annotations

import logging
import math
import time
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Any, Final

import pyvrp
from pyvrp.exceptions import PenaltyBoundWarning
from pyvrp.search import NeighbourhoodParams, PerturbationParams
from pyvrp.stop import (
    MaxIterations,
    MaxRuntime,
    MultipleCriteria,
    StoppingCriterion,
)

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.planning.parts import Group, by_carrier, parts_of
from dispatcher_daemon.planning.pyvrp_model import (
    MWH_PER_KWH,
    NO_PATH_MWH,
    StopsByVehicle,
    Visits,
    VrpModel,
)
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Travel
from dispatcher_daemon.settings import SearchSettings

log = logging.getLogger(__name__)


_HIGH_PENALTIES: Final = pyvrp.PenaltyParams(max_penalty=1e9)
"""The penalty starts at half of this: one excess unit costs more than an unserved stop."""


def _low_penalties(settings: SearchSettings) -> pyvrp.PenaltyParams:
    """Low penalties: the search may pass through infeasible routes, and gets further."""
    return pyvrp.PenaltyParams(max_penalty=settings.max_penalty_kwh * MWH_PER_KWH)


@dataclass(frozen=True)
class BaseRoutes:
    """Routes without platooning.

    Attributes:
        stops: by vehicle, those it serves in order; none for a vehicle that stays idle.
        unassigned: stops that are on no route.
        timed_out: True if the time limit ended the search, so that a repetition may
            give other routes.
    """

    stops: StopsByVehicle
    unassigned: tuple[str, ...]
    timed_out: bool


def base_routes(
    problem: RoutingProblem,
    travel: Travel,
    stops: Sequence[str],
    settings: SearchSettings,
    executor: Executor,
    seed: int,
    start: Mapping[str, Sequence[str]] | None = None,
) -> BaseRoutes:
    """Routes of least cost over the given stops, by `Travel.search_cost_kwh`.

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
    if not stops or not has_vehicle:
        return BaseRoutes({v.id: () for v in problem.fleet.vehicles}, tuple(stops), False)
    ends = time.monotonic() + settings.time_limit_s
    fleet = problem.fleet
    routes: StopsByVehicle = {vehicle.id: () for vehicle in fleet.vehicles}

    def first(groups: Sequence[Group], begin: Mapping[str, Sequence[str]] | None) -> list[_First]:
        models = [VrpModel(problem, travel, group.vehicles, group.stops) for group in groups]
        limit_s = settings.time_limit_s / 8 / max(1, len(models))
        return [_first_routes(model, settings, limit_s, seed, begin) for model in models]

    groups, anybodys = by_carrier(fleet, stops)
    if anybodys:
        # Among several carriers a search finds feasible routes late, unless it begins with some.
        for of_one in first(groups, start) if start is None else ():
            routes |= of_one.routes or {}
        groups = [Group(fleet.vehicles, stops)]
        start = routes if start is None else start
    firsts = first(groups, start)
    timed_out = any(of_one.timed_out for of_one in firsts)
    if all(of_one.routes is None for of_one in firsts):
        return BaseRoutes({v.id: () for v in fleet.vehicles}, tuple(stops), timed_out)
    for of_one in firsts:
        routes |= of_one.routes or {}
    for number in range(settings.rounds):
        left_s = (ends - time.monotonic()) / (settings.rounds - number)
        if left_s <= 0:
            timed_out = True
            break
        parts = [
            (vehicles, own, of_one.required)
            for group, of_one in zip(groups, firsts, strict=True)
            for divided in _divided(fleet, group, bool(anybodys) and number % 2 == 0)
            for vehicles, own in parts_of(
                problem,
                divided.vehicles,
                routes,
                _unassigned(divided.stops, routes),
                settings.part_stops,
                number,
            )
            if own
        ]
        models = [VrpModel(problem, travel, vehicles, own) for vehicles, own, _ in parts]
        limit_s = left_s / math.ceil(len(parts) / settings.workers)
        jobs = [
            _submit(
                executor,
                model.data(required),
                model.visits(routes),
                settings.iterations_per_stop * max(1, len(own)),
                limit_s,
                seed + number,
                _low_penalties(settings) if required else _HIGH_PENALTIES,
            )
            for model, (_, own, required) in zip(models, parts, strict=True)
        ]
        for model, job in zip(models, jobs, strict=True):
            try:
                found, cut = job.result()
            except Exception as error:
                # A worker that died costs its part one round.
                log.warning("part of the search failed: %s: %s", type(error).__name__, error)
                found, cut = None, True
            timed_out |= cut
            if found is not None:
                routes |= model.read(found)
    return BaseRoutes(routes, _unassigned(stops, routes), timed_out)


def _divided(fleet: Fleet, group: Group, by_carriers: bool) -> list[Group]:
    """A group, or its carriers with the stops that are theirs alone, if there are any."""
    return (by_carrier(fleet, group.stops)[0] if by_carriers else []) or [group]


def _unassigned(stops: Sequence[str], routes: StopsByVehicle) -> tuple[str, ...]:
    """Stops that are on no route."""
    served = {stop for of_one in routes.values() for stop in of_one}
    return tuple(stop for stop in stops if stop not in served)


def _submit(
    executor: Executor, data: pyvrp.ProblemData, start: Visits, *search: Any
) -> Future[tuple[Visits | None, bool]]:
    """A search on an executor; what keeps it from being taken on is raised with its result."""
    try:
        return executor.submit(_search, data, start, *search)
    except Exception as error:
        refused: Future[tuple[Visits | None, bool]] = Future()
        refused.set_exception(error)
        return refused


@dataclass(frozen=True)
class _First:
    """What a first search finds.

    Attributes:
        routes: None: none.
        required: whether they serve all stops; the search goes on with the same demand.
        timed_out: whether time ran out.
    """

    routes: StopsByVehicle | None
    required: bool
    timed_out: bool


def _first_routes(
    model: VrpModel,
    settings: SearchSettings,
    limit_s: float,
    seed: int,
    start: Mapping[str, Sequence[str]] | None,
) -> _First:
    """Routes over all stops, or over as many as fit."""
    required = not model.demand_exceeds_capacity()
    routes, timed_out = _initial_routes(model, required, settings, limit_s, seed, start)
    if routes is None and required:
        required = False
        routes, timed_out = _initial_routes(model, required, settings, limit_s, seed, start)
    return _First(routes, required, timed_out)


def _initial_routes(
    model: VrpModel,
    required: bool,
    settings: SearchSettings,
    limit_s: float,
    seed: int,
    start: Mapping[str, Sequence[str]] | None,
) -> tuple[StopsByVehicle | None, bool]:
    data = model.data(required)
    begin = None if start is None else model.visits(start)
    # Rounds improve more from routes that low penalties found.
    for penalty in (_low_penalties(settings), _HIGH_PENALTIES) if required else (_HIGH_PENALTIES,):
        iterations = settings.iterations_to_feasible
        found, cut = _search(data, begin, iterations, limit_s, seed, penalty, first=True)
        if found is not None:
            break
    return (None if found is None else model.read(found)), cut


def _search(
    data: pyvrp.ProblemData,
    start: Visits | None,
    iterations: int,
    limit_s: float,
    seed: int,
    penalty: pyvrp.PenaltyParams,
    *,
    first: bool = False,
) -> tuple[Visits | None, bool]:
    """(routes, or None if none are feasible; whether time ran out).

    Args:
        iterations: at most.
        first: whether the first feasible routes end it.
    """
    begin = None
    if start is not None:
        begin = pyvrp.Solution(data, [pyvrp.Route(data, visits, kind) for kind, visits in start])
    stop: list[StoppingCriterion] = [MaxIterations(iterations), MaxRuntime(limit_s)]
    if first:
        stop.append(lambda best_cost: best_cost < NO_PATH_MWH)
    with warnings.catch_warnings():
        # PyVRP warns when windows are tight; whether the answer keeps them is looked at below.
        warnings.simplefilter("ignore", PenaltyBoundWarning)
        result = pyvrp.solve(
            data,
            MultipleCriteria(stop),
            seed=seed % 2**32,
            collect_stats=False,
            display=False,
            params=_parameters(penalty),
            initial_solution=begin,
        )
    cut = result.runtime >= limit_s
    if not result.best.is_feasible() or result.best.distance() >= NO_PATH_MWH:
        return None, cut
    return [
        (route.vehicle_type(), [a.idx for a in route if a.is_client()])
        for route in result.best.routes()
    ], cut


def _parameters(penalty: pyvrp.PenaltyParams) -> pyvrp.SolveParams:
    """Smaller steps than PyVRP's own: they get further in seconds (docs/results.md)."""
    return pyvrp.SolveParams(
        ils=pyvrp.IteratedLocalSearchParams(history_length=100, exhaustive_on_best=False),
        penalty=penalty,
        neighbourhood=NeighbourhoodParams(num_neighbours=20),
        perturbation=PerturbationParams(1, 10),
    )
