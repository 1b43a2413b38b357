"""Blocks against the undivided optimum: one city's route form, solved whole and in blocks.

Both choose among the same options under the same model, so that what differs is the division.
Prints its figures as one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import networkx as nx
import numpy as np

from dispatcher_daemon.forms import RouteOption, RouteProblem
from dispatcher_daemon.planning.improvement import (
    add_discounted_ways,
    blocks_of,
    build_block,
    longest_wait_s,
    opportunity_graph,
    options_for,
)
from dispatcher_daemon.planning.platooning import Meetings
from dispatcher_daemon.planning.roads import Travel, roads_of
from dispatcher_daemon.planning.route_form import initial_plans
from dispatcher_daemon.planning.routes import Itinerary, Planner, base_routes
from dispatcher_daemon.settings import CitySettings, SearchSettings
from dispatcher_daemon.solvers import ExactSolver
from slipstream_lab.research.cities.generator import generate_city
from slipstream_lab.research.instances.forms import instance_cycle
from slipstream_lab.research.instances.instance import Instance

_BETTER_KWH: Final = 1e-9
_BLOCK_S: Final = 10.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Generate, solve both ways, print."""
    parser = argparse.ArgumentParser(prog="python -m slipstream_lab.benchmarks.routing.gap_run")
    for name in ("seed", "vehicles", "stops", "segments"):
        parser.add_argument(f"--{name}", type=int, required=True)
    parser.add_argument("--exact", type=float, required=True, help="s for the undivided solve")
    options = parser.parse_args(arguments)
    city = generate_city(
        options.seed, vehicles=options.vehicles, stops=options.stops, segments=options.segments
    )
    problem, graph = undivided(city, options.seed)
    result = measure_gap(problem, graph, CitySettings(), options.exact)
    print(json.dumps({"seed": options.seed, "vehicles": options.vehicles, **result}))


def undivided(city: Instance, seed: int) -> tuple[RouteProblem, nx.Graph]:
    """All vehicles' options around the base routes as one problem, and who could meet whom.

    The graph's nodes are vehicle numbers; each vehicle's first option is its base route.
    """
    problem, fleet = city.problem, city.problem.fleet
    travel = Travel(problem, roads_of(problem, city.snapshot))
    with ThreadPoolExecutor(1) as executor:
        stops = [stop.id for stop in fleet.stops]
        routes = base_routes(problem, travel, stops, SearchSettings(rounds=1), executor, seed)
    first = initial_plans(instance_cycle(city, seed), travel, routes.stops, {})
    add_discounted_ways(first.planner)
    return _whole(first.planner, first.base.itineraries, seed)


def _whole(
    planner: Planner, itineraries: Sequence[Itinerary], seed: int
) -> tuple[RouteProblem, nx.Graph]:
    meetings = Meetings(
        planner.book.shares,
        planner.book.sync_window_s,
        planner.book.longest,
        expected=planner.book.expected,
    )
    for itinerary in itineraries:
        meetings.add(itinerary.traversals)
    rng, most = np.random.default_rng(seed), CitySettings().options
    options = {
        i.number: options_for(planner, i, itineraries, meetings, most, rng) for i in itineraries
    }
    names = {n: vehicle.id for n, vehicle in enumerate(planner.problem.fleet.vehicles)}
    windows = [planner.windows.of(n) for n in names]
    waits = [longest_wait_s(planner, itinerary) for itinerary in itineraries]
    graph = opportunity_graph(
        itineraries, windows, waits, planner.book.shares, planner.book.sync_window_s
    )
    return build_block(names, options, meetings).problem, nx.relabel_nodes(graph, names)


def measure_gap(
    problem: RouteProblem, graph: nx.Graph, settings: CitySettings, exact_s: float
) -> dict[str, object]:
    """Solve whole and in blocks; what the figures mean:
    `slipstream_lab.benchmarks.routing.figures.Gap`.
    """
    start = frozenset(indices[0] for indices in problem.options_of.values())
    numbered = nx.convert_node_labels_to_integers(graph, label_attribute="name", ordering="sorted")
    name = nx.get_node_attributes(numbered, "name")
    chosen, idle, cut, blocks = start, 0, 0, 0
    while idle < settings.patience and cut < settings.max_sweeps:
        groups = blocks_of(numbered, max(2, settings.block_variables // settings.options), cut)
        blocks = blocks or len(groups)
        before = problem.objective_kwh(chosen)
        for group in groups:
            chosen = improved(problem, chosen, [name[n] for n in group])
        idle = 0 if problem.objective_kwh(chosen) < before - _BETTER_KWH else idle + 1
        cut += 1
    began = time.perf_counter()
    outcome = ExactSolver().solve(problem, exact_s, 1)
    took_s = time.perf_counter() - began
    found = problem.objective_kwh(chosen)
    best = found if outcome.selected is None else problem.objective_kwh(outcome.selected)
    return {
        "variables": problem.choices,
        "blocks": blocks,
        "start_kwh": problem.objective_kwh(start),
        "sweep_kwh": found,
        "optimum_kwh": min(best, found),
        "proven": outcome.status == "optimal",
        "exact_s": took_s,
    }


def improved(
    problem: RouteProblem, chosen: frozenset[int], vehicles: Sequence[str]
) -> frozenset[int]:
    """The best choice for some vehicles, proven, all others' as it is."""
    block, free = block_of(problem, chosen, vehicles)
    outcome = ExactSolver().solve(block, _BLOCK_S, 1)
    if outcome.selected is None:
        return chosen
    changed = (chosen - set(free)) | {free[position] for position in outcome.selected}
    return changed if problem.objective_kwh(changed) < problem.objective_kwh(chosen) else chosen


def block_of(
    problem: RouteProblem, chosen: frozenset[int], vehicles: Sequence[str]
) -> tuple[RouteProblem, list[int]]:
    """Some vehicles' options as a problem of their own, what they save with the others' present
    choice counted into their costs; and the indices of these options in the whole.
    """
    free = [i for vehicle in vehicles for i in problem.options_of[vehicle]]
    fixed = chosen - set(free)
    at = {i: position for position, i in enumerate(free)}
    cost = {i: problem.options[i].cost_kwh for i in free}
    savings: dict[tuple[int, int], float] = {}
    for (a, b), saving in problem.savings.items():
        if a in at and b in at:
            savings[min(at[a], at[b]), max(at[a], at[b])] = saving
        elif a in at and b in fixed:
            cost[a] -= saving
        elif b in at and a in fixed:
            cost[b] -= saving
    options = tuple(RouteOption(problem.options[i].vehicle, (), cost[i]) for i in free)
    return RouteProblem(tuple(vehicles), (), options, savings), free


if __name__ == "__main__":
    main()
