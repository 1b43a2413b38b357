"""Base routes of a fleet without platooning: a vehicle routing problem for PyVRP.

Least energy, with loads and time windows. What PyVRP needs is integer: energies in mWh, times in
tenths of a second, rounded so that a plan that fits there fits here.
"""

from __future__ import annotations

import logging
import math
import time
import warnings
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyvrp
from pyvrp.exceptions import PenaltyBoundWarning
from pyvrp.search import NeighbourhoodParams, PerturbationParams
from pyvrp.stop import (
    FirstFeasible,
    MaxIterations,
    MaxRuntime,
    MultipleCriteria,
    StoppingCriterion,
)

from dispatcher_daemon.fleet import Vehicle
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.settings import SearchSettings
from dispatcher_daemon.travel import Travel

log = logging.getLogger(__name__)

_MWH = 1e6
_TENTHS = 10.0
_NEVER_MWH = 10**10
"""Stands for a way that does not exist: 10 MWh."""
_PRIZE_MWH = 10**8
"""What leaving a stop out costs where not all can be served: 100 kWh, more than any detour."""

_NEVER_TENTHS = 10**9
_MOST_TO_FEASIBLE = 20_000
_PARAMETERS: Final = pyvrp.SolveParams(
    neighbourhood=NeighbourhoodParams(num_neighbours=20),
    perturbation=PerturbationParams(1, 10),
    ils=pyvrp.IteratedLocalSearchParams(history_length=100, exhaustive_on_best=False),
)
"""Smaller steps than PyVRP's own: they get further in seconds (docs/results.md)."""

StopsOf = dict[str, tuple[str, ...]]
Visits = list[tuple[int, list[int]]]
"""(vehicle type, clients in order) of each route in PyVRP's numbers."""


@dataclass(frozen=True)
class BaseRoutes:
    """Routes without platooning.

    Attributes:
        stops: by vehicle, those it serves in order; none for a vehicle that stays idle.
        left: stops that found no place.
        timed_out: True if the time limit cut the search short, so that it may end elsewhere when
            repeated.
    """

    stops: StopsOf
    left: tuple[str, ...]
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
    """Routes of least cost over the given stops, by `Travel.searched_kwh`.

    A first search over the whole city is short. After it, rounds cut the routes into parts by where
    they go, in another direction each time, and search the parts side by side. That is where most
    of the gain comes from: an iteration's time grows with the number of stops in it. If not all
    stops fit, as many as possible are served.

    Args:
        stops: ids; a vehicle whose first stop is not among them stays idle.
        executor: for the parts; processes, as PyVRP keeps the interpreter lock.
        seed: same seed, same routes, unless time runs out.
        start: routes to start from, by vehicle, instead of a first search.
    """
    ends = time.monotonic() + settings.time_limit_s
    whole = _Model(problem, travel, problem.fleet.vehicles, stops)
    required = not whole.demand_exceeds_capacity()
    routes, timed_out = _first_routes(whole, required, settings, seed, start)
    if routes is None and required:
        required = False
        routes, timed_out = _first_routes(whole, required, settings, seed, start)
    if routes is None:
        return BaseRoutes({v.id: () for v in problem.fleet.vehicles}, tuple(stops), timed_out)
    for number in range(settings.rounds):
        left_s = (ends - time.monotonic()) / (settings.rounds - number)
        if left_s <= 0:
            timed_out = True
            break
        left_out = [s for s in stops if all(s not in of_one for of_one in routes.values())]
        parts = _parts(problem, routes, left_out, settings.part_stops, number)
        models = [_Model(problem, travel, vehicles, own) for vehicles, own in parts]
        limit_s = left_s / math.ceil(len(parts) / settings.workers)
        jobs = [
            executor.submit(
                _search,
                model.data(required),
                model.visits(routes),
                settings.iterations_per_stop * max(1, len(own)),
                limit_s,
                seed + number,
            )
            for model, (_, own) in zip(models, parts, strict=True)
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
    served = {name for of_one in routes.values() for name in of_one}
    return BaseRoutes(routes, tuple(s for s in stops if s not in served), timed_out)


def _first_routes(
    model: _Model,
    required: bool,
    settings: SearchSettings,
    seed: int,
    start: Mapping[str, Sequence[str]] | None,
) -> tuple[StopsOf | None, bool]:
    data = model.data(required)
    begin = None if start is None else model.visits(start)
    found, cut = _search(data, begin, None, settings.time_limit_s / 4, seed)
    return (None if found is None else model.read(found)), cut


def _search(
    data: pyvrp.ProblemData,
    start: Visits | None,
    iterations: int | None,
    limit_s: float,
    seed: int,
) -> tuple[Visits | None, bool]:
    """(routes, or None if none are feasible; whether time ran out).

    Args:
        iterations: None: until something is feasible, and never more than many.
    """
    begin = None
    if start is not None:
        begin = pyvrp.Solution(data, [pyvrp.Route(data, visits, kind) for kind, visits in start])
    most = _MOST_TO_FEASIBLE if iterations is None else iterations
    stop: list[StoppingCriterion] = [MaxIterations(most), MaxRuntime(limit_s)]
    if iterations is None:
        stop.append(FirstFeasible())
    with warnings.catch_warnings():
        # PyVRP warns when windows are tight; whether the answer keeps them is looked at below.
        warnings.simplefilter("ignore", PenaltyBoundWarning)
        result = pyvrp.solve(
            data,
            MultipleCriteria(stop),
            seed=seed % 2**32,
            collect_stats=False,
            display=False,
            params=_PARAMETERS,
            initial_solution=begin,
        )
    cut = result.runtime >= limit_s
    if not result.best.is_feasible():
        return None, cut
    return [
        (route.vehicle_type(), [a.idx for a in route if a.is_client()])
        for route in result.best.routes()
    ], cut


def _parts(
    problem: RoutingProblem,
    routes: StopsOf,
    left_out: Sequence[str],
    part_stops: int,
    number: int,
) -> list[tuple[list[Vehicle], list[str]]]:
    """(vehicles, stops) of each part: routes cut at the median of where their stops lie, again
    and again, across a direction that turns from cut to cut and from round to round.

    Idle vehicles and stops without a route are dealt out.
    """
    fleet, junctions = problem.fleet, problem.network.junctions
    driving = [v for v in fleet.vehicles if routes[v.id]]
    idle = [v for v in fleet.vehicles if not routes[v.id]]
    centre = {
        v.id: np.mean([junctions[fleet.node(s)] for s in routes[v.id]], axis=0) for v in driving
    }
    groups, angle = [driving], float(number)
    total = sum(len(routes[v.id]) for v in driving)
    while total > part_stops * len(groups):
        direction = np.array([np.cos(angle), np.sin(angle)])
        halves = []
        for group in groups:
            ordered = sorted(group, key=lambda v: (float(centre[v.id] @ direction), v.id))
            count = np.cumsum([len(routes[v.id]) for v in ordered])
            middle = int(np.searchsorted(count, count[-1] / 2)) + 1
            halves += [half for half in (ordered[:middle], ordered[middle:]) if half]
        if len(halves) == len(groups):
            break
        groups, angle = halves, angle + np.pi / 2
    return [
        (
            [*group, *idle[i :: len(groups)]],
            [*(s for v in group for s in routes[v.id]), *left_out[i :: len(groups)]],
        )
        for i, group in enumerate(groups)
    ]


class _Model:
    """The translation of one problem to PyVRP and back."""

    def __init__(
        self,
        problem: RoutingProblem,
        travel: Travel,
        vehicles: Sequence[Vehicle],
        stops: Sequence[str],
    ) -> None:
        fleet = problem.fleet
        served = set(stops)
        self._problem, self._travel = problem, travel
        kinds: dict[Vehicle, list[Vehicle]] = defaultdict(list)
        for vehicle in vehicles:
            if vehicle.first_stop is None:
                any_id = {"id": "any", "depot": self._depot(vehicle)}
                kinds[vehicle.model_copy(update=any_id)].append(vehicle)
            elif vehicle.first_stop in served:
                kinds[vehicle].append(vehicle)
        self._kinds = list(kinds.items())
        first = {v.first_stop for v in fleet.vehicles}
        self._pooled = [name for name in stops if name not in first]
        self._fleet = fleet
        self._vehicles = vehicles

    def _depot(self, vehicle: Vehicle) -> str:
        return self._problem.fleet.depot_of(vehicle).id

    def _begin(self, kind: Vehicle) -> tuple[str, float, int]:
        """(place, earliest departure from it, load delivered before): the depot, or the stop that
        a vehicle with a first stop serves before it is free.
        """
        depot = self._depot(kind)
        if kind.first_stop is None:
            return depot, kind.ready_s, 0
        stop = self._fleet.stop_by_id[kind.first_stop]
        way = self._travel.duration_s[self._travel.row[depot], self._travel.row[stop.id]]
        begins = max(kind.ready_s + way, stop.earliest_s)
        return stop.id, begins + stop.service_s, stop.demand

    def demand_exceeds_capacity(self) -> bool:
        """True if the stops' demand cannot be carried by all vehicles together."""
        free = 0
        for kind, vehicles in self._kinds:
            if kind.capacity is None:
                return False
            free += len(vehicles) * max(0, kind.capacity - self._begin(kind)[2])
        return sum(self._fleet.stop_by_id[s].demand for s in self._pooled) > free

    def data(self, required: bool) -> pyvrp.ProblemData:
        """The problem in PyVRP's terms."""
        places = self._places()
        at = {place: i for i, place in enumerate(places)}
        rows = np.array([self._travel.row[place] for place in places])
        energy = self._travel.searched_kwh[np.ix_(rows, rows)]
        seconds = self._travel.duration_s[np.ix_(rows, rows)]
        ways = np.isfinite(energy)
        # PyVRP's type hints know no array of two dimensions.
        distance: Any = np.where(ways, np.rint(np.where(ways, energy, 0) * _MWH), _NEVER_MWH)
        tenths: Any = np.where(ways, np.ceil(np.where(ways, seconds, 0) * _TENTHS), 0)
        np.fill_diagonal(distance, 0)
        np.fill_diagonal(tenths, 0)
        depots = places[: len(places) - len(self._pooled)]
        return pyvrp.ProblemData(
            locations=[pyvrp.Location(0, 0, name=place) for place in places],
            clients=[self._client(name, at[name], required) for name in self._pooled],
            depots=[pyvrp.Depot(location=i) for i in range(len(depots))],
            vehicle_types=[self._vehicle_type(kind, len(of), at) for kind, of in self._kinds],
            distance_matrices=[distance.astype(np.int64)],
            duration_matrices=[tenths.astype(np.int64)],
        )

    def _places(self) -> list[str]:
        """Depots and first stops, where vehicles begin, then the pooled stops."""
        begins = [self._begin(kind)[0] for kind, _ in self._kinds]
        ends = [self._depot(kind) for kind, _ in self._kinds]
        return [*dict.fromkeys([*ends, *begins]), *self._pooled]

    def _client(self, name: str, location: int, required: bool) -> pyvrp.Client:
        stop = self._fleet.stop_by_id[name]
        return pyvrp.Client(
            location=location,
            delivery=[stop.demand],
            service_duration=_up(stop.service_s),
            tw_early=_up(stop.earliest_s),
            tw_late=_NEVER_TENTHS if stop.latest_s is None else _down(stop.latest_s),
            required=required,
            prize=0 if required else _PRIZE_MWH,
        )

    def _vehicle_type(self, kind: Vehicle, number: int, at: Mapping[str, int]) -> pyvrp.VehicleType:
        place, begins_s, delivered = self._begin(kind)
        latest_s = begins_s
        if kind.depart_by_s is not None:
            latest_s += kind.depart_by_s - kind.ready_s
        early, late = _up(begins_s), max(_up(begins_s), _down(latest_s))
        back = _NEVER_TENTHS if kind.return_by_s is None else _down(kind.return_by_s)
        unlimited = sum(stop.demand for stop in self._fleet.stops)
        return pyvrp.VehicleType(
            num_available=number,
            capacity=[max(0, (unlimited if kind.capacity is None else kind.capacity) - delivered)],
            start_depot=at[place],
            end_depot=at[self._depot(kind)],
            tw_early=early,
            start_late=late,
            tw_late=max(late, back),
        )

    def visits(self, routes: Mapping[str, Sequence[str]]) -> Visits:
        """Routes by vehicle in PyVRP's numbers; stops that are not asked for are left out."""
        client = {name: i for i, name in enumerate(self._pooled)}
        found = []
        for number, (_, vehicles) in enumerate(self._kinds):
            for vehicle in vehicles:
                clients = [client[s] for s in routes.get(vehicle.id, ()) if s in client]
                if clients:
                    found.append((number, clients))
        return found

    def read(self, routes: Visits) -> StopsOf:
        """Routes by vehicle; those of one kind of vehicle are dealt out in order."""
        waiting: dict[int, list[tuple[str, ...]]] = defaultdict(list)
        for kind, clients in routes:
            waiting[kind].append(tuple(self._pooled[i] for i in clients))
        stops: StopsOf = {vehicle.id: () for vehicle in self._vehicles}
        for number, (_, vehicles) in enumerate(self._kinds):
            own = sorted(waiting[number])
            for position, vehicle in enumerate(vehicles):
                pooled = own[position] if position < len(own) else ()
                first = () if vehicle.first_stop is None else (vehicle.first_stop,)
                stops[vehicle.id] = (*first, *pooled)
        return stops


def _up(seconds: float) -> int:
    return int(np.ceil(seconds * _TENTHS))


def _down(seconds: float) -> int:
    return int(np.floor(seconds * _TENTHS))
