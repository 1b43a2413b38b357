"""Plans as messages: a vehicle needs no map beside its plan."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from vehicle_agent.leg import legs_of


def test_a_plan_has_the_road_that_its_agent_drives_by(
    demo: RoutingProblem, traffic: Callable[..., TrafficSnapshot], now_ns: int
) -> None:
    """Length, limit and the junction behind each segment, as the network has them."""
    settings = DispatcherSettings(solvers=("exact",))
    solve = solve_in_process([ExactSolver()])
    plans = run_cycle(Cycle(demo, traffic(), settings, 1, now_ns, 1), solve).plans
    assert plans
    for plan in plans:
        for before, after in pairwise(plan.segments):
            road = demo.network.segments[before.segment]
            assert (before.length_m, before.lanes) == (road.length_m, road.lanes)
            assert before.speed_limit_mps == road.speed_limit_mps
            known = demo.network.crossings.get((before.segment, after.segment))
            assert (before.crossing is not None) == (before.leg == after.leg)
            if before.crossing is not None and known is not None:
                assert before.crossing.length_m == known.length_m
                assert before.crossing.speed_mps == known.speed_mps
        legs = legs_of(plan.cycle, plan.segments, len(plan.stops) - 1)
        length_m = sum(leg.lengths_m[i] for leg in legs if leg for i in range(len(leg.path)))
        assert abs(length_m - plan.distance_m) < 1e-6
