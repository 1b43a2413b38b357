"""Routes, departures and platoons of a whole fleet: the route form at the scale of a city.

Base routes come from a search without platooning. Vehicles then choose among options of route and
departure, in blocks small enough for any solver, around everybody else's present choice, sweep
after sweep until nothing improves. A change is taken only if it improves the exact objective, so
the plan is never worse than the base routes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from dispatcher_daemon.planning.base_routes import base_routes
from dispatcher_daemon.planning.itineraries import Itinerary, Planner
from dispatcher_daemon.planning.pyvrp_model import StopsOf
from dispatcher_daemon.planning.servability import unservable, without
from dispatcher_daemon.planning.sweeps import Choice, Sweep, Sweeping, choice_of, simple_choices
from dispatcher_daemon.platooning.vehicles_on_road import RoadUser
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.travel import Travel, roads_of
from dispatcher_daemon.settings import CitySettings, SearchSettings
from dispatcher_daemon.solvers.pool import Solve
from dispatcher_daemon.traffic import TrafficSnapshot

_RESERVE = 0.05
"""Share of a deadline that is kept for what is under way when it is noticed."""


@dataclass(frozen=True)
class CityPlan:
    """The plan of a fleet.

    Attributes:
        choice: the plan.
        base: the same fleet routed without platooning, everybody leaving when ready.
        greedy: base routes, departures chosen one vehicle after the other.
        unserved: reason by stop that no vehicle serves.
        sweeps: in order.
        wall_s: time of each stage: roads, base, greedy, second, sweeps.
        timed_out: True if a deadline ended a stage, so that a repetition may end elsewhere.
    """

    choice: Choice
    base: Choice
    greedy: Choice
    unserved: Mapping[str, str]
    sweeps: tuple[Sweep, ...]
    wall_s: Mapping[str, float]
    timed_out: bool


def plan_city(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: CitySettings,
    executor: Executor,
    solve: Solve,
    *,
    sync_window_s: float,
    seed: int,
    deadline_s: float = math.inf,
    reference_s: float = 0.0,
    on_road: Sequence[RoadUser] = (),
    start: Mapping[str, Sequence[str]] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> CityPlan:
    """Plan a fleet.

    Args:
        executor: runs the parts of the search for base routes.
        solve: runs the blocks' solvers; `settings.solvers` names them, the best answer counts.
        seed: same input and seed give the same plan unless time runs out.
        deadline_s: for all of it; each stage takes its share and keeps what it has.
        reference_s: when a vehicle that is ready at once leaves.
        on_road: vehicles sent earlier, to be met.
        start: routes to start from, as of the last cycle.
    """
    began = clock()
    ends = began + (1 - _RESERVE) * deadline_s
    walls: dict[str, float] = {}

    def stage(name: str) -> None:
        walls[name] = clock() - began - sum(walls.values())

    def limited(search: SearchSettings, share: float) -> SearchSettings:
        limit_s = max(0.01, share * (ends - clock()))
        return search.model_copy(update={"time_limit_s": min(search.time_limit_s, limit_s)})

    travel = Travel(problem, roads_of(problem, snapshot))
    missing = unservable(problem, snapshot, travel)
    lost = any(v.first_stop in missing for v in problem.fleet.vehicles)
    if lost and len(missing) < len(problem.fleet.stops):
        problem = without(problem, missing)
        travel = Travel(problem, travel.roads)
    stops = [stop.id for stop in problem.fleet.stops if stop.id not in missing]
    stage("roads")
    search = limited(settings.search, settings.base_share)
    routes = base_routes(problem, travel, stops, search, executor, seed, start)
    missing |= dict.fromkeys(routes.left, "no vehicle has room and time for it")
    stage("base")
    planner, begin, base, greedy = first_plans(
        problem,
        snapshot,
        travel,
        routes.stops,
        missing,
        settings,
        sync_window_s,
        reference_s,
        on_road,
    )
    stage("greedy")
    sweeping = Sweeping(planner, settings, solve, begin)
    timed_out = routes.timed_out
    if settings.second_rounds:
        rounds = {"rounds": settings.second_rounds}
        search = limited(settings.search.model_copy(update=rounds), settings.base_share)
        stops = [stop for stop in stops if stop not in missing]
        second = base_routes(
            problem, planner.travels[1], stops, search, executor, seed + 1, routes.stops
        )
        timed_out |= second.timed_out
        if not second.left:
            sweeping.cross(second.stops, seed, ends, clock)
    stage("second")
    sweeps, late = sweeping.run(seed, ends, clock)
    stage("sweeps")
    return CityPlan(
        choice_of(planner, sweeping.present),
        base,
        greedy,
        missing,
        sweeps,
        walls,
        timed_out or late,
    )


def first_plans(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    travel: Travel,
    routes: StopsOf,
    missing: dict[str, str],
    settings: CitySettings,
    sync_window_s: float,
    reference_s: float,
    on_road: Sequence[RoadUser] = (),
) -> tuple[Planner, list[Itinerary], Choice, Choice]:
    """(planner, the better itineraries to begin with, everybody at once, scheduled greedily)."""
    planner = Planner(problem, snapshot, [travel], sync_window_s, reference_s, on_road=on_road)
    alone = at_once(planner, routes, missing)
    planner.travels += (attracted(problem, travel, planner),)
    if sum(len(i.route.legs) for i in alone if i.route is not None) <= settings.ways_legs:
        planner.ways_per_leg = settings.ways
    base, greedy = simple_choices(planner, alone)
    begin = min((base, greedy), key=lambda choice: choice.objective_kwh)
    return planner, list(begin.itineraries), base, greedy


def at_once(planner: Planner, stops: StopsOf, missing: dict[str, str]) -> list[Itinerary]:
    """Everybody leaves when ready; stops that then miss a window are not served, and added to
    ``missing`` with the reason.
    """
    itineraries = []
    for number, vehicle in enumerate(planner.problem.fleet.vehicles):
        visits = stops[vehicle.id]
        itinerary = planner.itinerary(number, visits, planner.legs(number, visits))
        if itinerary is None:
            itinerary, dropped = _what_can_be_kept(planner, number, visits)
            missing |= dict.fromkeys(dropped, f"{vehicle.id} would be too late for it")
        itineraries.append(itinerary)
    return itineraries


def _what_can_be_kept(
    planner: Planner, number: int, visits: Sequence[str]
) -> tuple[Itinerary, list[str]]:
    """The route without the stops that miss their windows, and these; without its first stop a
    vehicle stays idle.

    The search knows durations to about a second, so this is for what it cannot foresee.
    """
    kept, dropped = planner.idle(number), []
    for stop in visits:
        tried = (*kept.stops, stop)
        itinerary = planner.itinerary(number, tried, planner.legs(number, tried))
        if itinerary is not None:
            kept = itinerary
        elif stop == planner.problem.fleet.vehicles[number].first_stop:
            return planner.idle(number), list(visits)
        else:
            dropped.append(stop)
    return kept, dropped


def attracted(problem: RoutingProblem, travel: Travel, planner: Planner) -> Travel:
    """Ways that like open segments: worth a follower's share, as if there were one to follow."""
    worth = {name: shares.follower_kwh for name, shares in planner.shares.items()}
    discount = np.array([worth.get(name, 0.0) for name in travel.roads.ids])
    return Travel(problem, travel.roads, discount)
