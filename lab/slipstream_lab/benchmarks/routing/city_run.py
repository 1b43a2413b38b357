"""One cycle of one generated city in this process; prints its figures as one line of JSON."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import resource
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Final

import pyvrp

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.plans import RouteEnergy, route_energy, summarise
from dispatcher_daemon.planning.platooning import expected_drafting, form_platoons
from dispatcher_daemon.planning.roads import Route, fleet_travel
from dispatcher_daemon.planning.route_form import FleetPlan, initial_plans, plan_fleet
from dispatcher_daemon.planning.routes import VrpModel
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers import Solver, make_solver
from dispatcher_daemon.solvers.workers import Solve, executor_solve
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy.consumption import stop_energy_kwh
from slipstream_lab.research.cities.generator import generate_city
from slipstream_lab.research.instances.forms import instance_cycle
from slipstream_lab.research.instances.instance import Instance

WORKERS: Final = max(1, min(2, os.cpu_count() or 1))
"""The aims are for two cores."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Generate, plan, print."""
    parser = argparse.ArgumentParser(prog="python -m slipstream_lab.benchmarks.routing.city_run")
    for name in ("seed", "vehicles", "stops", "segments", "solver-seed"):
        parser.add_argument(f"--{name}", type=int, required=True)
    parser.add_argument("--budget", type=float, required=True, help="s")
    parser.add_argument("--rival", type=float, default=0.0, help="CPU s of PyVRP's own search")
    parser.add_argument("--long", action="store_true", help="search for as long as it may")
    parser.add_argument("--unguarded", action="store_true", help="only the budget ends the search")
    options = parser.parse_args(arguments)
    city = generate_city(
        options.seed,
        vehicles=options.vehicles,
        stops=options.stops,
        segments=options.segments,
    )
    settings = CitySettings()
    if options.long:
        settings = long_search(options.budget)
    elif options.unguarded:
        settings = unguarded(options.budget)
    city = at_default_prices(city)
    result = run_city(city, settings, options.budget, options.solver_seed)
    if options.rival > 0:
        result["rival_kwh"] = rival_kwh(city, options.rival, options.solver_seed)
        result["rival_cpu_s"] = options.rival
    print(json.dumps({"seed": options.seed, **result}))


def at_default_prices(city: Instance) -> Instance:
    """A city with the price of time that a dispatcher has unless its settings say otherwise."""
    price_kw = DispatcherSettings().prices.price_of_time_kw
    return replace(city, problem=replace(city.problem, price_of_time_kw=price_kw))


def rival_kwh(city: Instance, cpu_s: float, seed: int) -> float | None:
    """Exact cost of the routes without platooning that PyVRP finds by its own defaults, the whole
    fleet at once, all vehicles leaving when ready; None if some stop is late or left out.
    """
    problem = city.problem
    travel = fleet_travel(problem, city.snapshot)
    names = [stop.id for stop in problem.fleet.stops]
    model = VrpModel(problem, travel, problem.fleet.vehicles, names)
    ends = time.process_time() + cpu_s
    found = pyvrp.solve(
        model.data(required=True),
        lambda _: time.process_time() > ends,
        seed=seed,
        collect_stats=False,
        display=False,
    ).best
    if not found.is_feasible():
        return None
    visits = [
        (route.vehicle_type(), [a.idx for a in route if a.is_client()]) for route in found.routes()
    ]
    missing: dict[str, str] = {}
    plans = initial_plans(instance_cycle(city, seed), travel, model.read(visits), missing)
    return None if missing else plans.base.cost_kwh


def unguarded(budget_s: float) -> CitySettings:
    """The usual settings without the guard on the search's time, which would flatten a slope."""
    usual = CitySettings()
    search = usual.search.model_copy(update={"time_limit_s": budget_s})
    return usual.model_copy(update={"search": search})


def long_search(budget_s: float) -> CitySettings:
    """Settings that use all of a long budget: more rounds, larger blocks, more options.

    A round gets an equal share of the time that is left, so there are no more of them than seconds
    allow a good search each.
    """
    return CitySettings(
        search=SearchSettings(
            rounds=max(5, int(budget_s / 8)), iterations_per_stop=100, time_limit_s=budget_s
        ),
        second_rounds=max(2, int(budget_s / 20)),
        block_variables=80,
        options=8,
        max_sweeps=1000,
        patience=20,
        block_deadline_s=20.0,
    )


def run_city(
    city: Instance, settings: CitySettings, budget_s: float, solver_seed: int
) -> dict[str, object]:
    """Figures of one cycle; what they mean: `slipstream_lab.benchmarks.routing.figures.CityRun`.

    Workers are up before the clock starts, as a daemon keeps them from cycle to cycle.
    """
    cycle_settings = DispatcherSettings(
        city=settings, solvers=settings.solvers, deadline_s=budget_s, interval_s=2 * budget_s
    )
    cycle = instance_cycle(city, solver_seed, cycle_settings)
    with workers(settings) as (executor, solve):
        began, used = time.perf_counter(), _cpu_s()
        plan = plan_fleet(cycle, executor, solve)
        wall_s, own_cpu_s = time.perf_counter() - began, _cpu_s() - used
    # Workers' time is known once they have ended; their start is in it.
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "vehicles": len(city.problem.fleet.vehicles),
        "stops": len(city.problem.fleet.stops),
        "segments": len(city.problem.network.segments),
        "solver_seed": solver_seed,
        "budget_s": budget_s,
        "wall_s": wall_s,
        "cpu_s": own_cpu_s + children.ru_utime + children.ru_stime,
        **_objectives(plan),
        **_energy(city, plan),
    }


@contextmanager
def workers(settings: CitySettings) -> Iterator[tuple[Executor, Solve]]:
    """Warm worker processes, for base routes and for the blocks' solvers."""
    solvers = [make_solver(name, DispatcherSettings()) for name in settings.solvers]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, spawn, initializer=_warm_up, initargs=(solvers,)) as pool:
        list(pool.map(time.sleep, [0.5] * WORKERS))
        yield pool, executor_solve(pool, solvers, workers=WORKERS)


def _warm_up(solvers: Sequence[Solver]) -> None:
    from dispatcher_daemon.planning.routes import search_within  # noqa: F401

    for solver in solvers:
        solver.warm_up()


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _objectives(plan: FleetPlan) -> dict[str, object]:
    return {
        "objective_kwh": plan.choice.objective_kwh,
        "cost_kwh": plan.choice.cost_kwh,
        "saving_kwh": plan.choice.saving_kwh,
        "base_kwh": plan.base.cost_kwh,
        "base_met_kwh": plan.base.objective_kwh,
        "greedy_kwh": plan.greedy.objective_kwh,
        "unserved": len(plan.unserved),
        "sweeps": len(plan.sweeps),
        "blocks": plan.sweeps[0].blocks if plan.sweeps else 0,
        "timed_out": plan.timed_out,
        "stages_s": dict(plan.wall_s),
    }


def _energy(city: Instance, plan: FleetPlan) -> dict[str, object]:
    """Physical energy of the plan against the VRP without platooning."""
    ours, base = plan.choice.routes, plan.base.routes
    expected = expected_drafting(city.problem, city.snapshot)
    places = form_platoons(
        ours,
        city.snapshot,
        city.sync_window_s,
        city.problem.longest_platoon,
        1,
        expected=expected,
    )
    driven = [route_energy(city.problem, route, places) for route in ours]
    alone: list[RouteEnergy] = [route_energy(city.problem, route, {}) for route in base]
    summary = summarise("the VRP without platooning", alone, driven, city.problem.price_of_time_kw)
    stops_kwh = [expected_stops_kwh(city.problem, city.snapshot, routes) for routes in (ours, base)]
    return {
        "base_driven_kwh": summary.baseline_kwh,
        "saved_distance_kwh": summary.saved_distance_kwh,
        "saved_drag_kwh": summary.saved_drag_kwh,
        "saved_acceleration_kwh": summary.saved_acceleration_kwh,
        "saved_stops_kwh": stops_kwh[1] - stops_kwh[0],
        "driving_h": _driving_h(ours),
        "base_driving_h": _driving_h(base),
    }


def expected_stops_kwh(
    problem: RoutingProblem, snapshot: TrafficSnapshot, routes: Sequence[Route]
) -> float:
    """Energy that stops at signals and junctions are expected to cost on some routes, kWh."""
    return sum(
        traffic.stops * stop_energy_kwh(traffic.speed_mps, problem.vehicle)
        for route in routes
        for leg in route.legs
        for traffic in (snapshot.segments[name] for name in leg.path)
    )


def _driving_h(routes: Sequence[Route]) -> float:
    return sum(leg.drive.duration_s for route in routes for leg in route.legs) / 3600


if __name__ == "__main__":
    main()
