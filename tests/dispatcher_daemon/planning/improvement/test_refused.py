"""Why two vans on one road are no platoon there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem, routing_problem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.improvement import refused
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.settings import (
    CitySettings,
    DispatcherSettings,
    SearchSettings,
)
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.explain import RefusedPlatoon, refusal_line
from slipstream.prices import PriceSettings
from slipstream_lab.research.cities.generator import CityShape, generate_city

Traffic = Callable[..., TrafficSnapshot]


def cycle(
    demo: RoutingProblem, snapshot: TrafficSnapshot, waiting_hour: float = 0.0, **changes: Any
) -> CycleResult:
    """The demo fleet's cycle, van-a changed."""
    settings = DispatcherSettings(
        solvers=("exact",), prices=PriceSettings(waiting_hour=waiting_hour)
    )
    van_a, *others = demo.fleet.vehicles
    vehicles = (van_a.model_copy(update=changes), *others)
    fleet = type(demo.fleet)(**{**demo.fleet.parts, "vehicles": vehicles})
    problem = routing_problem(demo.network, fleet, settings)
    this = Cycle(problem, snapshot, settings, 3, snapshot.now_ns, 11)
    return run_cycle(this, solve_in_process([ExactSolver()]))


def on_avenue(result: CycleResult) -> list[RefusedPlatoon]:
    """Refused platoons of the two vans on the avenue to the east."""
    return [one for one in result.refused if "avenue_east" in one.segments]


def test_together_in_calm_traffic_they_are_a_platoon_and_nothing_is_refused(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """The plan has the platoon, and no account of a refusal."""
    result = cycle(demo, traffic(avenue_east=1))
    assert any(s.platoon for plan in result.plans for s in plan.segments)
    assert on_avenue(result) == []


@pytest.mark.parametrize(
    ("y_e", "reason", "detail", "words"),
    [
        (0, "turbulent", "turbulent", "traffic there was turbulent"),
        (None, "unknown", "uncertain", "the traffic there was not known (uncertain)"),
    ],
)
def test_a_closed_gate_is_told_as_turbulent_or_unknown(
    demo: RoutingProblem, traffic: Traffic, y_e: int | None, reason: str, detail: str, words: str
) -> None:
    """On the road that every tour begins with, and what the platoon would have saved there."""
    found = cycle(demo, traffic(depot_road_east=y_e)).refused
    (one,) = (one for one in found if "depot_road_east" in one.segments)
    assert (one.reason, one.detail, one.apart_s) == (reason, detail, 2.0)
    assert one.saving_kwh > 0
    assert one.cost_kwh is None
    assert words in refusal_line(one)


def test_vans_whose_windows_allow_no_meeting_are_not_together_in_time(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """One is ready some minute later, and the other may not wait for it."""
    (one,) = on_avenue(cycle(demo, traffic(avenue_east=1), ready_s=60.0))
    assert (one.vehicles, one.reason) == (("van-b", "van-a"), "apart")
    assert one.apart_s == pytest.approx(58.0, abs=0.5)
    assert "not together in time, 58.0 s apart" in refusal_line(one)


def test_a_wait_that_costs_more_than_it_saves_is_not_worth_it(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """A free wait is taken; one at the price of a wage is refused with both figures."""
    late = {"depart_by_s": 300.0}
    vans = [v.model_copy(update={"ready_s": 60.0}) for v in demo.fleet.vehicles[1:]]
    fleet = type(demo.fleet)(**{**demo.fleet.parts, "vehicles": (demo.fleet.vehicles[0], *vans)})
    problem = RoutingProblem(demo.network, fleet)
    free = cycle(problem, traffic(avenue_east=1), 0.0, **late)
    assert on_avenue(free) == []
    (account,) = (a for a in free.accounts if a.vehicle == "van-a")
    assert account.waiting_s == pytest.approx(60.0, abs=0.5)
    assert account.driven_kwh < account.alone_kwh

    (one,) = on_avenue(cycle(problem, traffic(avenue_east=1), 20.0, **late))
    assert (one.vehicles, one.reason) == (("van-a", "van-b"), "not_worth")
    # A minute at 20 an hour and 0.20 a kWh.
    assert one.cost_kwh == pytest.approx(60 / 3600 * 100, abs=0.02)
    assert one.cost_kwh is not None
    assert 0 < one.saving_kwh < one.cost_kwh
    assert "not worth it" in refusal_line(one)


def test_a_fault_in_what_is_told_does_not_cost_the_plan(
    demo: RoutingProblem, traffic: Traffic, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plans go out, and nothing is told of refused platoons."""

    def broken(*_: object) -> float:
        raise ZeroDivisionError

    monkeypatch.setattr(refused, "pair_saving_kwh", broken)
    result = cycle(demo, traffic(avenue_east=0))
    assert (result.report.status, len(result.plans), result.refused) == ("ok", 2, ())


@pytest.mark.long
def test_a_city_s_list_is_bounded_and_begins_with_what_is_worth_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of each reason a bounded number; none is of a pair that is a platoon on these segments."""
    shape = CityShape(depots=1, open_share=0.9)
    city = generate_city(2, vehicles=12, stops=36, segments=160, shape=shape)
    search = SearchSettings(rounds=2, iterations_per_stop=5, workers=1)
    city_settings = CitySettings(search=search, second_rounds=1, max_sweeps=4, patience=2)
    settings = DispatcherSettings(form="route", solvers=("exact",), city=city_settings)
    this = Cycle(city.problem, city.snapshot, settings, 3, city.snapshot.now_ns, 11)
    result = run_cycle(this, solve_in_process([ExactSolver()]))
    worth = [one.saving_kwh for one in result.refused]
    assert len(worth) > 2
    assert worth == sorted(worth, reverse=True)
    plans = {plan.vehicle: plan for plan in result.plans}
    for one in result.refused:
        for segment in one.segments:
            first, second = (
                {s.platoon for s in plans[v].segments if s.segment == segment} for v in one.vehicles
            )
            assert (first & second) <= {None}
    monkeypatch.setattr(refused, "MAX_OF_A_REASON", 2)
    fewer = run_cycle(this, solve_in_process([ExactSolver()])).refused
    assert 0 < len(fewer) < len(worth)
    assert sum(one.reason == "unknown" for one in result.refused) > 2
    assert [one for one in fewer if one.reason == "unknown"] == [
        one for one in result.refused if one.reason == "unknown"
    ][:2]
