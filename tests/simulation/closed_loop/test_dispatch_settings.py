"""The dispatcher as it is set in the closed loop."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from dispatcher_daemon.cycle import run_cycle
from dispatcher_daemon.plans.candidates import Cycle
from research.cities.generator import CityShape, generate_city
from simulation.closed_loop.dispatch_settings import evaluation_settings, evaluation_solve


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
                    Cycle(
                        city.problem,
                        replace(city.snapshot, now_ns=10**9),
                        evaluation_settings(),
                        3,
                        10**9,
                        5,
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
