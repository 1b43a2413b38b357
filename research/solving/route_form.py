"""The route form of a small fleet in one piece, for solvers to be tried on."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dispatcher_daemon.planning.base_routes import base_routes
from dispatcher_daemon.planning.blocks import Block, build_block
from dispatcher_daemon.planning.exchanges import best_exchanges
from dispatcher_daemon.planning.fleet_plan import first_plans
from dispatcher_daemon.planning.itineraries import Planner
from dispatcher_daemon.planning.options import options_for
from dispatcher_daemon.planning.servability import unservable
from dispatcher_daemon.planning.sweeps import Choice
from dispatcher_daemon.platooning.meetings import Meetings
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads.travel import Travel, roads_of
from dispatcher_daemon.settings import CitySettings
from dispatcher_daemon.traffic import TrafficSnapshot


@dataclass(frozen=True)
class RouteForm:
    """All driving vehicles as one block.

    Attributes:
        planner: that made the options; `sweeping.choice_of` evaluates a choice with it.
        block: `block.problem` is for solvers, `block.chosen` reads their answer.
        base: everybody leaves when ready, platooning left to chance.
        greedy: routed, then scheduled one vehicle after the other; the first options are these.
        unserved: reason by stop.
    """

    planner: Planner
    block: Block
    base: Choice
    greedy: Choice
    unserved: Mapping[str, str]


def route_problem_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: CitySettings,
    *,
    sync_window_s: float,
    seed: int,
    reference_s: float = 0.0,
) -> RouteForm:
    """Base routes, greedy departures, up to `settings.options` options of each vehicle, and the
    best exchanges of stops between each two.

    Savings are expanded around the greedy plan (`blocks.build_block`).
    """
    travel = Travel(problem, roads_of(problem, snapshot))
    unserved = unservable(problem, snapshot, travel)
    stops = [stop.id for stop in problem.fleet.stops if stop.id not in unserved]
    with ThreadPoolExecutor(max_workers=1) as executor:
        routes = base_routes(problem, travel, stops, settings.search, executor, seed)
    unserved |= dict.fromkeys(routes.left, "no vehicle has room and time for it")
    planner, begin, base, greedy = first_plans(
        problem, snapshot, travel, routes.stops, unserved, settings, sync_window_s, reference_s
    )
    meetings = Meetings(planner.shares, sync_window_s)
    for itinerary in begin:
        meetings.add(itinerary.way)
    driving = [itinerary for itinerary in begin if itinerary.route is not None]
    rng = np.random.default_rng(seed)
    options = {
        i.number: options_for(planner, i, driving, meetings, settings.options, rng) for i in driving
    }
    for one, other in combinations(driving, 2):
        for pair in best_exchanges(planner, (one, other), meetings, settings.options - 1, rng):
            for itinerary in pair:
                of_one = options[itinerary.number]
                if all(itinerary.key != known.key for known in of_one):
                    of_one.append(itinerary)
    names = {n: v.id for n, v in enumerate(problem.fleet.vehicles)}
    return RouteForm(planner, build_block(names, options, meetings), base, greedy, unserved)
