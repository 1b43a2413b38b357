"""The dispatcher as it is set in the closed loop."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest

from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.planning.cycle.cycle import cycle_of, run_cycle
from dispatcher_daemon.settings import DispatcherSettings
from slipstream_lab.research.cities.generator import CityShape, generate_city
from slipstream_lab.simulation.closed_loop.dispatch_settings import (
    DEFAULT_TIME_WORTH_KW,
    evaluation_settings,
    evaluation_solve,
    installed_settings,
)
from slipstream_lab.simulation.closed_loop.dispatching import settings_of
from slipstream_lab.simulation.closed_loop.policy import AS_DRIVING, Policy, WaitingPrices
from slipstream_lab.simulation.evaluation.arms import INSTALLED, INSTALLED_PRIORITY, POLICIES
from slipstream_lab.simulation.scenarios.demand import draw_deliveries, fleet_at
from slipstream_lab.simulation.scenarios.scenario import load_scenario


def test_cycles_are_the_same_again_and_leave_at_once() -> None:
    """Two runs of a cycle give the same plans, made by what the settings name; vehicles leave from
    the moment that the fleet's times count from, however long the searches may take.
    """
    shape = CityShape(depots=1, ready_within_s=0.0)
    city = generate_city(4, vehicles=4, stops=10, segments=120, shape=shape)
    results = []
    for _ in range(2):
        with ThreadPoolExecutor(1) as executor:
            results.append(
                run_cycle(
                    cycle_of(
                        city.problem,
                        replace(city.snapshot, now_ns=10**9),
                        evaluation_settings(),
                        3,
                        seed=5,
                        reference_delay_s=0.0,
                    ),
                    evaluation_solve(),
                    executor,
                )
            )
    one, other = results
    assert one.report.status == "ok"
    assert one.plans
    assert one.plans == other.plans
    assert one.report.objective_kwh == other.report.objective_kwh
    assert {report.solver for report in one.report.solvers} == {"exact"}
    assert all(plan.depart_ns >= 10**9 for plan in one.plans)
    assert min(plan.depart_ns for plan in one.plans) < 200 * 10**9
    latest = {v.id: v.depart_by_s or 0.0 for v in city.problem.fleet.vehicles}
    assert all(1e-9 * plan.depart_ns - 1 <= latest[plan.vehicle] + 1e-3 for plan in one.plans)


@pytest.mark.parametrize(
    ("waiting", "waiting_kw", "standing_kw"),
    [
        (AS_DRIVING, 25.0, 25.0),
        (WaitingPrices(waiting_kw=0.0), 0.0, 25.0),
        (WaitingPrices(waiting_kw=0.0, standing_kw=2.0), 0.0, 2.0),
        (WaitingPrices(standing_kw=0.0), 25.0, 0.0),
    ],
)
def test_what_waiting_costs_reaches_the_problem(
    waiting: WaitingPrices, waiting_kw: float, standing_kw: float
) -> None:
    """At the depot and at stops; the value of time by which agents choose a second to leave at is
    another thing. By the paper's objective nothing but energy has a price, as in a dispatcher.
    """
    scenario = load_scenario("corridor")
    deliveries = draw_deliveries(scenario.fleet, scenario.network, 1)
    fleet = fleet_at(deliveries, 43_200.0, dict.fromkeys(deliveries.vehicles, 0.0), ())
    assert fleet is not None
    settings = settings_of(Policy("C", frozenset({"routes"})), 25.0, waiting, 1)
    problem = routing_problem(scenario.network, fleet, settings)
    assert problem.price_of_time_kw == 25.0
    assert problem.price_of_waiting_kw == waiting_kw
    assert problem.price_of_standing_kw == standing_kw
    paper = settings_of(Policy("C"), 0.0, waiting, 1)
    problem = routing_problem(scenario.network, fleet, paper)
    assert (problem.objective, problem.price_of_waiting_kw) == ("paper", 0.0)
    assert paper.priced_advice.value_of_time_kw == DEFAULT_TIME_WORTH_KW


@pytest.mark.parametrize("name", [INSTALLED, INSTALLED_PRIORITY])
def test_an_installed_arm_is_set_as_an_installation(name: str) -> None:
    """Key by key, but for the clock that ends searches, circuits beside the exact solver, the seed,
    and the priority asked for.
    """
    own, default = (
        settings.model_dump()
        for settings in (installed_settings(POLICIES[name], 7), DispatcherSettings())
    )
    differ = {
        path: (own[path], default[path])
        for own, default in [(_flat(own), _flat(default))]
        for path in own.keys() | default.keys()
        if own.get(path) != default.get(path)
    }
    clocks = ["city.block_deadline_s", "city.search.time_limit_s", "deadline_s"]
    assert sorted(differ.keys() - {"advice.signal_priority"}) == [*clocks, "seed", "solvers"]
    assert all(longer > usual for longer, usual in map(differ.__getitem__, clocks))
    assert set(differ["solvers"][0]) < set(differ["solvers"][1])
    priority = {"advice.signal_priority": (True, False)} if name == INSTALLED_PRIORITY else {}
    assert {k: v for k, v in differ.items() if k.startswith("advice")} == priority


def _flat(tables: dict[str, Any], prefix: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for key, value in tables.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat
