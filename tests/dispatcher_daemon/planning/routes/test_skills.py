"""Stops that need skills, or are kept for a vehicle, go to vehicles that may serve them."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.arc_form import arc_form_obstacle
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.routes import unservable
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
SETTINGS = DispatcherSettings(
    solvers=("exact",),
    city=CitySettings(
        search=SearchSettings(rounds=1, iterations_per_stop=20, workers=1, time_limit_s=5.0),
        second_rounds=1,
        max_sweeps=3,
    ),
)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_each_stop_is_served_by_a_vehicle_that_may(town: Town, seed: int) -> None:
    """However much shorter another vehicle's way is: neighbours are kept for different ones."""
    nodes = [f"{x}{y}" for x in range(4) for y in range(3)]
    asks = [{"vehicle": f"van-{n}"} for n in range(5)] + [
        {"skills": ["lift"]},
        {"skills": ["cold", "lift"]},
        {"skills": ["cold"], "vehicle": "van-3"},
    ]
    stops = [
        {"id": f"s{n}", "node": node, "service_s": 20.0, **(asks[n] if n < len(asks) else {})}
        for n, node in enumerate(nodes)
    ]
    skills: list[list[str]] = [[], ["lift"], ["cold", "lift"], ["cold"], []]
    problem, snapshot = town(stops, [{"skills": own} for own in skills], seed=seed)
    assert arc_form_obstacle(problem.fleet) == "stop 's0' is not for all vehicles"
    cycle = Cycle(problem, snapshot, SETTINGS, 1, snapshot.now_ns, seed)
    result = run_cycle(cycle, solve_in_process([ExactSolver()]))
    assert result.report.unserved == ()
    holder = {visit.stop: plan.vehicle for plan in result.plans for visit in plan.service_stops}
    assert holder.keys() == {f"s{n}" for n in range(12)}
    assert [holder[f"s{n}"] for n in (0, 1, 2, 3, 4, 6, 7)] == [
        *(f"van-{n}" for n in range(5)),
        "van-2",
        "van-3",
    ]
    assert holder["s5"] in ("van-1", "van-2")


def test_a_stop_that_nobody_here_may_serve_says_whom_it_needs(town: Town) -> None:
    """The others are planned."""
    problem, snapshot = town(
        [
            {"id": "heavy", "node": "11", "skills": ["lift"]},
            {"id": "hers", "node": "12", "vehicle": "van-1"},
            {"id": "any", "node": "13"},
        ],
        [{"skills": ["lift"]}, {}],
    )
    fleet = problem.fleet.model_copy(update={"vehicles": (problem.fleet.vehicles[1],)})
    smaller = RoutingProblem(problem.network, fleet)
    assert unservable(smaller, snapshot) == {
        "heavy": "no vehicle with the skills lift is free",
    }
    fleet = problem.fleet.model_copy(update={"vehicles": (problem.fleet.vehicles[0],)})
    assert unservable(RoutingProblem(problem.network, fleet), snapshot) == {
        "hers": "it is kept for 'van-1', which is not free or may not serve it",
    }
