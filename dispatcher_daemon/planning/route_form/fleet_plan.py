"""Routes, departures and platoons of a whole fleet: the route form at the scale of a city.

Base routes come from a search without platooning. Vehicles then choose among options of route and
departure, in blocks small enough for any solver, with the other vehicles' choices fixed, sweep
after sweep until nothing improves. A change is accepted only if it improves the exact objective, so
the plan is never worse than the base routes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Final

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.improvement.carriers import Accounts, nobody_worse_off
from dispatcher_daemon.planning.improvement.options import add_discounted_ways
from dispatcher_daemon.planning.improvement.sweeps import (
    BlockDescent,
    Choice,
    Sweep,
    Trial,
    choice_of,
    scheduled,
)
from dispatcher_daemon.planning.plans import Cycle, DeclinedMeeting, Gains
from dispatcher_daemon.planning.roads import Travel, fleet_travel, searched_again
from dispatcher_daemon.planning.routes.base_routes import BaseRoutes, base_routes
from dispatcher_daemon.planning.routes.bound_part import bound_routes, drivable, unbound
from dispatcher_daemon.planning.routes.insertion import cheapest_insertion
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.planning.routes.pyvrp_model import StopsByVehicle
from dispatcher_daemon.planning.routes.servability import unservable, without
from dispatcher_daemon.settings import CitySettings, SearchSettings
from dispatcher_daemon.solvers.workers import Solve

NO_ROOM: Final = "no vehicle has room and time for it"
_NO_CHARGE: Final = "has no charge left for it"
NO_VEHICLE: Final = "no vehicle is free"
_RESERVE: Final = 0.05
"""Share of a deadline that is kept for work that is in progress when it expires."""
_CLOSING_CHECKS: Final = 3.0
"""How many times as long as the check of the base plan that of the plan takes, with platoons and
with what is told of it: 2.6 to 4.1 were seen, the reserve has room for the rest."""
_SECOND_SHARE: Final = 0.5
"""Of the search's time limit, for the second search."""
_WAYS_SHARE: Final = 0.5
"""Of the time that is left, for ways with discounts; the second search and sweeps have the rest."""
_PACE_SHARE: Final = 1 / 8
"""Of that time; before, nobody can tell how long all of them take."""


CheckBase = Callable[[Cycle, Choice, Mapping[str, str]], None]
"""Checks a plan of a cycle; the mapping has the reason by stop that no vehicle serves."""


@dataclass(frozen=True)
class FleetPlan:
    """The plan of a fleet.

    Attributes:
        cycle: as it was planned, without bound vehicles that no way leads on for.
        choice: the plan; no carrier has less than by `base`.
        base: the same fleet routed without platooning, all vehicles leaving when ready.
        greedy: base routes, departures chosen one vehicle after the other.
        trials: answers of the dispatcher's solvers that are not asked for every block.
        wall_s: time of each stage: roads, base, check, greedy, ways, second, sweeps, trials,
            carriers.
        timed_out: True if a deadline ended a stage, so that a repetition may end elsewhere.
        gains_kwh: of each carrier by the plan, where there are several.
        base_gains_kwh: likewise by `base` with the platoons that form by chance.
    """

    cycle: Cycle
    choice: Choice
    base: Choice
    greedy: Choice
    unserved: Mapping[str, str]
    sweeps: tuple[Sweep, ...]
    trials: tuple[Trial, ...]
    wall_s: Mapping[str, float]
    timed_out: bool
    gains_kwh: Gains
    base_gains_kwh: Gains
    declined: tuple[DeclinedMeeting, ...] = ()


def plan_fleet(
    cycle: Cycle,
    executor: Executor,
    solve: Solve,
    clock: Callable[[], float] = time.monotonic,
    check: CheckBase = lambda *_: None,
) -> FleetPlan:
    """Plan the fleet of a cycle by the settings' section ``city``, within the cycle's deadline.

    The same cycle and seed give the same plan unless time runs out. Each stage takes its share of
    the deadline and keeps what it has.

    Args:
        check: called with the base plan as soon as it is known. The plan is done so much earlier
            that it can be checked within the deadline too, by the time that this takes.
    """
    settings, seed = city_settings(cycle), cycle.seed
    began = clock()
    ends = began + (1 - _RESERVE) * cycle.settings.deadline_s
    walls: dict[str, float] = {}

    def stage(name: str) -> None:
        walls[name] = clock() - began - sum(walls.values())

    def limited(search: SearchSettings, share: float) -> SearchSettings:
        limit_s = max(0.01, share * (ends - clock()))
        return search.model_copy(update={"time_limit_s": min(search.time_limit_s, limit_s)})

    whole, travel = with_ways(cycle)
    cycle, travel, missing = servable(whole, travel)
    stage("roads")
    search = limited(settings.search, settings.base_share)
    routes = first_routes(cycle, travel, missing, search, executor, clock)
    missing |= dict.fromkeys(routes.unassigned, NO_ROOM)
    stage("base")

    def checked(base: Choice) -> None:
        nonlocal ends
        before = clock()
        check(whole, base, missing)
        walls["check"] = clock() - before
        ends -= _CLOSING_CHECKS * walls["check"]

    first = initial_plans(cycle, travel, routes.stops, missing, lambda: clock() < ends, checked)
    late = clock() >= ends
    stage("greedy")
    if not late:
        late = not add_discounted_ways(first.planner, keeps_pace(ends, clock))
    stage("ways")
    descent = BlockDescent(first.planner, settings, solve, first.best.itineraries)
    timed_out = routes.timed_out or late
    if settings.second_rounds and not late:
        limit_s = _SECOND_SHARE * settings.search.time_limit_s
        fewer = {"rounds": settings.second_rounds, "time_limit_s": limit_s}
        search = limited(settings.search.model_copy(update=fewer), settings.base_share)
        part = unbound(cycle)
        if part is not None:
            discounted = first.planner.travels[1]
            left = stops_but(part, missing)
            second = base_routes(
                part, discounted, left, search, executor, seed + 1, routes.stops, clock
            )
            timed_out |= second.timed_out
            if not second.unassigned:
                descent.adopt(routes.stops | second.stops, seed, ends, clock)
    stage("second")
    sweeps, late = descent.run(seed, ends, clock)
    stage("sweeps")
    others = [name for name in cycle.settings.solvers if name not in settings.solvers]
    trials = descent.try_solvers(others, seed, ends, clock) if others else ()
    stage("trials")
    base = first.base.itineraries
    accounts = nobody_worse_off(
        first.planner, base, descent.present, cycle.on_road, lambda: clock() < ends
    )
    gains, base_gains = Gains(), Gains()
    if accounts is not None:
        if any(a is not b for a, b in zip(accounts.present, descent.present, strict=True)):
            descent.keep_to(accounts)
            more, cut = descent.run(seed + len(sweeps), ends, clock)
            sweeps, late = (*sweeps, *more), late or cut
        gains = accounts.gains_kwh()
        base_gains = Accounts(first.planner, base, base, cycle.on_road).gains_kwh()
    stage("carriers")
    return FleetPlan(
        whole,
        choice_of(first.planner, descent.present),
        first.base,
        first.greedy,
        missing,
        sweeps,
        trials,
        walls,
        timed_out or late,
        gains,
        base_gains,
        tuple(descent.declined.values()),
    )


def city_settings(cycle: Cycle) -> CitySettings:
    """A fleet of one block asks all of the dispatcher's solvers; a larger one those for blocks, and
    the others for one of them.
    """
    city = cycle.settings.city
    if len(cycle.problem.fleet.vehicles) * city.options <= city.block_variables:
        return city.model_copy(update={"solvers": cycle.settings.solvers})
    return city


def with_ways(cycle: Cycle) -> tuple[Cycle, Travel]:
    """(the cycle without bound vehicles that no way leads on for, paths between its places)."""
    travel = fleet_travel(cycle.problem, cycle.snapshot)
    return drivable(cycle, travel), travel


def servable(cycle: Cycle, travel: Travel) -> tuple[Cycle, Travel, dict[str, str]]:
    """(the cycle, paths between its places, reason by stop that no vehicle can serve).

    Where a vehicle's first stop is among these, the cycle has none of them.
    """
    problem, part = cycle.problem, unbound(cycle)
    loaded = {stop for own in cycle.commitments for stop in own.stops}
    if part is None:
        pooled = [stop.id for stop in problem.fleet.stops if stop.id not in loaded]
        return cycle, travel, dict.fromkeys(pooled, NO_VEHICLE)
    missing = unservable(part, cycle.snapshot, travel)
    lost = any(v.first_stop in missing for v in part.fleet.vehicles)
    if lost and len(missing) < len(problem.fleet.stops):
        cycle = replace(cycle, problem=without(problem, missing))
        travel = searched_again(travel, cycle.problem)
    return cycle, travel, missing


def first_routes(
    cycle: Cycle,
    travel: Travel,
    missing: Collection[str],
    search: SearchSettings,
    executor: Executor,
    clock: Callable[[], float] = time.monotonic,
) -> BaseRoutes:
    """Routes of the free vehicles by a search, and of the bound ones in their best order."""
    bound, part = bound_routes(cycle, travel), unbound(cycle)
    if part is None:
        return BaseRoutes(bound, (), False)
    stops = stops_but(part, missing)
    routes = base_routes(part, travel, stops, search, executor, cycle.seed, cycle.start, clock)
    return replace(routes, stops=bound | routes.stops)


def stops_but(problem: RoutingProblem, missing: Collection[str]) -> list[str]:
    """Ids of a problem's stops without the missing ones."""
    return [stop.id for stop in problem.fleet.stops if stop.id not in missing]


@dataclass(frozen=True)
class InitialPlans:
    """Plans before any block is solved.

    Attributes:
        planner: that made them; it knows no ways with discounts yet.
        base: all vehicles leave when ready.
        greedy: departures chosen one vehicle after the other.
    """

    planner: Planner
    base: Choice
    greedy: Choice

    @property
    def best(self) -> Choice:
        """The better of the two."""
        return min((self.base, self.greedy), key=lambda choice: choice.objective_kwh)


def initial_plans(
    cycle: Cycle,
    travel: Travel,
    routes: StopsByVehicle,
    missing: dict[str, str],
    has_time: Callable[[], bool] = lambda: True,
    base_is_known: Callable[[Choice], None] = lambda _: None,
) -> InitialPlans:
    """Plans of given routes; stops that miss a window are added to ``missing``.

    Args:
        has_time: whether another vehicle's departure may be chosen; the others leave when ready.
    """
    city, planner = cycle.settings.city, Planner.of(cycle, [travel])
    base = choice_of(planner, departing_when_ready(planner, routes, missing))
    base_is_known(base)
    if sum(len(i.route.legs) for i in base.itineraries if i.route is not None) <= city.ways_legs:
        planner.paths_per_leg = city.ways
    return InitialPlans(planner, base, scheduled(planner, base, has_time))


def departing_when_ready(
    planner: Planner, stops: StopsByVehicle, missing: dict[str, str]
) -> list[Itinerary]:
    """All vehicles leave when ready. Stops whose windows are then missed, or for which the battery
    does not last, are not served; they are added to ``missing`` with the reason. What the search
    does not know, charge and breaks, may leave room for them elsewhere.
    """
    itineraries: list[Itinerary] = []
    retried: list[str] = []
    for number, vehicle in enumerate(planner.problem.fleet.vehicles):
        visits = stops[vehicle.id]
        itinerary = planner.itinerary(number, visits, planner.legs(number, visits))
        if itinerary is None:
            itinerary, dropped = _feasible_part(planner, number, visits)
            missing |= {stop: f"{vehicle.id} {why}" for stop, why in dropped.items()}
            retried += [s for s, why in dropped.items() if why == _NO_CHARGE or vehicle.breaks]
        itineraries.append(itinerary)
    for stop in retried:
        better = cheapest_insertion(planner, itineraries, stop)
        if better is not None and stop in planner.problem.fleet.pooled:
            itineraries[better.number] = better
            del missing[stop]
    return itineraries


def _feasible_part(
    planner: Planner, number: int, visits: Sequence[str]
) -> tuple[Itinerary, dict[str, str]]:
    """The route without the stops that miss their windows or need too much charge, and these with
    the reason; without its first stop a vehicle stays idle.

    It is needed because the search knows durations to about a second only, and charge not at all.
    """
    kept, dropped = planner.idle(number), dict[str, str]()
    for stop in visits:
        tried = (*kept.stops, stop)
        legs = planner.legs(number, tried)
        itinerary = planner.itinerary(number, tried, legs)
        if itinerary is not None:
            kept = itinerary
            continue
        lasts = legs is not None and planner.lasts(number, legs)
        why = "would be too late for it" if lasts else _NO_CHARGE
        if stop == planner.problem.fleet.vehicles[number].first_stop:
            return planner.idle(number), dict.fromkeys(visits, why)
        dropped[stop] = why
    return kept, dropped


def keeps_pace(ends: float, clock: Callable[[], float]) -> Callable[[float], bool]:
    """Whether a search that begins now will be done when it has taken its share of the time up to
    ``ends``, if the rest of it takes as long as the share that is done.
    """
    began = clock()
    limit_s = _WAYS_SHARE * (ends - began)
    return lambda done: clock() - began <= limit_s * max(done, _PACE_SHARE)
