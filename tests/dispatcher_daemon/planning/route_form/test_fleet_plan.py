from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.improvement.sweeps import Choice, choice_of, scheduled
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.routes import lateness_s
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.route_form.fleet_plan import (
    CheckBase,
    FleetPlan,
    departing_when_ready,
    keeps_pace,
    plan_fleet,
)
from dispatcher_daemon.planning.routes.itineraries import Planner
from dispatcher_daemon.settings import (
    CitySettings,
    DispatcherSettings,
    SearchSettings,
)
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.prices import PriceSettings
from slipstream_lab.research.cities.generator import CityShape, generate_city

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
QUICK = CitySettings(
    search=SearchSettings(rounds=2, iterations_per_stop=5, workers=1),
    second_rounds=1,
    max_sweeps=4,
    patience=2,
)


def plan(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    city: CitySettings = QUICK,
    *,
    seed: int = 1,
    deadline_s: float = 1000.0,
    reference_s: float = 10.0,
    clock: Callable[[], float] = time.monotonic,
    check: CheckBase = lambda *_: None,
    **more: Any,
) -> FleetPlan:
    """A plan made in this process."""
    settings = DispatcherSettings(
        city=city, solvers=city.solvers, interval_s=2000.0, deadline_s=deadline_s
    )
    cycle = Cycle(problem, snapshot, settings, 1, 0, seed, reference_s, **more)
    with ThreadPoolExecutor(1) as thread:
        return plan_fleet(cycle, thread, solve_in_process([ExactSolver()]), clock, check)


def faults(problem: RoutingProblem, made: FleetPlan) -> list[str]:
    """Stops that are neither served once nor listed, windows missed, loads too large."""
    fleet = problem.fleet
    visits = [stop for i in made.choice.itineraries for stop in i.stops]
    found = [s.id for s in fleet.stops if visits.count(s.id) != (s.id not in made.unserved)]
    for vehicle, itinerary in zip(fleet.vehicles, made.choice.itineraries, strict=True):
        load = sum(fleet.stop_by_id[s].demand for s in itinerary.stops)
        if vehicle.capacity is not None and load > vehicle.capacity:
            found.append(f"{vehicle.id} carries {load}")
        if (
            itinerary.route is not None
            and lateness_s(problem, vehicle, itinerary.route, 10.0) > 1e-6
        ):
            found.append(f"{vehicle.id} is late")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_plans_are_sound_and_never_worse_than_their_rivals(seed: int) -> None:
    """Every stop once, windows and loads kept, and no more objective than the base routes or the
    greedy schedule; the objective is that of an evaluation from nothing.
    """
    city = generate_city(
        seed,
        vehicles=12,
        stops=36,
        segments=160,
        shape=CityShape(depots=1, open_share=0.9, window_share=0.3),
    )
    # At no price of time vans keep to slow streets, where there is nobody to meet.
    problem = replace(city.problem, price_of_time_kw=PriceSettings().price_of_time_kw)
    made = plan(problem, city.snapshot)
    assert made.unserved == {}
    assert faults(problem, made) == []
    assert not made.timed_out
    best = made.choice.objective_kwh
    assert best <= min(made.base.objective_kwh, made.greedy.objective_kwh) + 1e-9
    assert best < made.base.objective_kwh - 1e-6
    assert made.choice.saving_kwh > 0
    travel = Travel(problem, roads_of(problem, city.snapshot))
    fresh = Planner(problem, city.snapshot, [travel], 3.0, 10.0)
    again = choice_of(fresh, made.choice.itineraries)
    assert again.objective_kwh == pytest.approx(best, abs=1e-9)
    if made.sweeps:
        assert made.sweeps[-1].objective_kwh == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("calls", [3, 9])
def test_a_clock_that_runs_out_in_any_stage_leaves_a_sound_plan(calls: int) -> None:
    """After so many looks at the clock the deadline has passed: what was known then is the plan,
    and it says that time ended it.
    """
    city = generate_city(1, vehicles=8, stops=24, segments=100)
    looks = 0

    def clock() -> float:
        nonlocal looks
        looks += 1
        return 0.0 if looks <= calls else 1000.0

    made = plan(city.problem, city.snapshot, clock=clock)
    assert made.timed_out
    assert made.unserved == {}
    assert faults(city.problem, made) == []
    assert made.choice.objective_kwh <= made.base.objective_kwh + 1e-9


class SearchedTime:
    """A clock by which only searches take time: a second for each call of scipy's `dijkstra`."""

    def __init__(self, patched: pytest.MonkeyPatch) -> None:
        """Search one junction at a time."""
        self.now_s = 0.0

        def timed(*args: Any, **named: Any) -> Any:
            self.now_s += 1.0
            return dijkstra(*args, **named)

        patched.setattr("dispatcher_daemon.planning.roads.all_pairs._SEARCHED_AT_ONCE", 1)
        patched.setattr("dispatcher_daemon.planning.roads.all_pairs.dijkstra", timed)

    def __call__(self) -> float:
        """Seconds."""
        return self.now_s


@pytest.mark.slow
@pytest.mark.parametrize(("deadline_s", "complete"), [(40.0, False), (1000.0, True)])
def test_ways_with_discounts_that_take_too_long_are_given_up(
    deadline_s: float, complete: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As soon as it shows that they would take more than half of what is left; sweeps go on
    without them.
    """
    city = generate_city(1, vehicles=8, stops=24, segments=100)
    clock = SearchedTime(monkeypatch)
    made = plan(city.problem, city.snapshot, deadline_s=deadline_s, clock=clock)
    junctions = made.wall_s["roads"]
    assert junctions == 15.0
    assert made.wall_s["ways"] == (junctions if complete else 2.0)
    assert made.timed_out is not complete
    assert clock.now_s <= deadline_s
    assert made.sweeps
    assert made.unserved == {}
    assert faults(city.problem, made) == []
    assert made.choice.objective_kwh <= made.base.objective_kwh + 1e-9


def test_the_pace_of_a_search_is_judged_when_it_shows() -> None:
    """Of 80 s that are left it has 40: what is a tenth done then has taken too long, and so has
    what is half done after 21; before 5 s nobody knows.
    """
    now_s = 20.0
    may_go_on = keeps_pace(100.0, lambda: now_s)
    now_s = 25.0
    assert may_go_on(0.001)
    now_s = 25.1
    assert not may_go_on(0.1)
    assert may_go_on(0.2)
    now_s = 41.0
    assert not may_go_on(0.5)
    assert may_go_on(0.6)


@pytest.mark.slow
@pytest.mark.parametrize(("check_s", "in_time"), [(20.0, True), (30.0, False)])
def test_a_plan_is_done_early_enough_for_its_check(check_s: float, in_time: bool) -> None:
    """Of 100 s 5 are kept, and three times the time that the check of the base plan took."""
    city = generate_city(1, vehicles=8, stops=24, segments=100)
    now_s = 0.0

    def check(cycle: Cycle, base: Choice, unserved: Mapping[str, str]) -> None:
        nonlocal now_s
        assert cycle.problem is city.problem
        assert len(base.routes) == sum(i.route is not None for i in base.itineraries)
        assert not unserved
        now_s += check_s

    made = plan(city.problem, city.snapshot, deadline_s=100.0, clock=lambda: now_s, check=check)
    assert made.wall_s["check"] == check_s
    assert bool(made.sweeps) is in_time
    assert made.timed_out is not in_time
    assert faults(city.problem, made) == []
    assert made.choice.objective_kwh <= made.base.objective_kwh + 1e-9


@pytest.mark.slow
def test_departures_are_chosen_while_there_is_time() -> None:
    """Those ready last choose first; whoever comes too late leaves when ready."""
    city = generate_city(1, vehicles=8, stops=24, segments=100)
    made = plan(city.problem, city.snapshot)
    planner = Planner(
        city.problem,
        city.snapshot,
        [Travel(city.problem, roads_of(city.problem, city.snapshot))],
        3.0,
    )
    ready = departing_when_ready(
        planner,
        {
            v.id: i.stops
            for v, i in zip(city.problem.fleet.vehicles, made.base.itineraries, strict=True)
        },
        {},
    )
    base = choice_of(planner, ready)
    greedy = scheduled(planner, base, lambda: False)
    assert greedy.itineraries == base.itineraries == tuple(ready)
    left = iter([True] * 3)
    some = scheduled(planner, base, lambda: next(left, False))
    every = scheduled(planner, base)
    latest = sorted(ready, key=lambda i: (-i.depart_s, i.number))
    for itinerary in latest[:3]:
        assert some.itineraries[itinerary.number].key == every.itineraries[itinerary.number].key
    assert all(some.itineraries[i.number] is i for i in latest[3:])


@pytest.mark.slow
def test_a_short_deadline_is_kept_with_a_sound_plan() -> None:
    """Half a second for searches that would take minutes: a plan in time, and that it was cut."""
    city = generate_city(5, vehicles=10, stops=50, segments=200)
    endless = QUICK.model_copy(
        update={
            "search": SearchSettings(rounds=1000, iterations_per_stop=1000, workers=1),
            "second_rounds": 1000,
            "max_sweeps": 1000,
            "patience": 1000,
        }
    )
    # Modules are loaded outside of the time that is measured.
    plan(city.problem, city.snapshot, QUICK, deadline_s=0.2)
    began = time.monotonic()
    made = plan(city.problem, city.snapshot, endless, deadline_s=0.5)
    assert time.monotonic() - began < 5
    assert made.timed_out
    assert made.unserved == {}
    assert faults(city.problem, made) == []
    assert made.choice.objective_kwh <= made.base.objective_kwh + 1e-9


def test_what_nobody_can_serve_is_listed_and_the_rest_is_served(town: Town) -> None:
    """Out of reach, too heavy, too late, one too many: each is named with its reason."""
    stops: list[dict[str, Any]] = [
        {"id": "far", "node": "q"},
        {"id": "heavy", "node": "33", "demand": 9},
        {"id": "late", "node": "33", "latest_s": 5.0},
        *(
            {"id": f"s{i}", "node": n, "demand": 2}
            for i, n in enumerate(("33", "30", "03", "22", "11"))
        ),
    ]
    problem, snapshot = town(stops, [{"capacity": 4, "depart_by_s": 60.0}, {"capacity": 4}])
    made = plan(problem, snapshot)
    assert "cannot be reached" in made.unserved["far"]
    assert "above every capacity" in made.unserved["heavy"]
    assert "its window closes at 5 s" in made.unserved["late"]
    left = set(made.unserved) - {"far", "heavy", "late"}
    assert len(left) == 1
    assert made.unserved[left.pop()] == "no vehicle has room and time for it"
    assert faults(problem, made) == []
    assert made.choice.objective_kwh <= made.greedy.objective_kwh + 1e-9


def test_a_fleet_that_can_serve_nothing_stays_at_home(town: Town) -> None:
    """All stops out of reach: an empty plan that costs nothing, not an error."""
    problem, snapshot = town(["q", "p"], [{}, {"first_stop": "s0"}])
    made = plan(problem, snapshot)
    assert set(made.unserved) == {"s0", "s1"}
    assert all(i.route is None for i in made.choice.itineraries)
    assert (made.choice.objective_kwh, made.sweeps[-1].blocks if made.sweeps else 0) == (0.0, 0)


def test_only_the_stop_that_is_late_is_given_up(town: Town) -> None:
    """Of routes that turn out not to fit, the stops that can be kept are kept; a vehicle that
    cannot serve what it has loaded stays at home.
    """
    stops = [
        {"id": "a", "node": "11", "service_s": 20.0},
        {"id": "b", "node": "33", "service_s": 20.0, "latest_s": 60.0},
        {"id": "c", "node": "22", "service_s": 20.0},
        {"id": "d", "node": "33", "latest_s": 60.0},
        {"id": "e", "node": "11"},
    ]
    problem, snapshot = town(stops, [{}, {"first_stop": "d"}])
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    missing: dict[str, str] = {}
    kept = departing_when_ready(planner, {"van-0": ("a", "b", "c"), "van-1": ("d", "e")}, missing)
    assert [i.stops for i in kept] == [("a", "c"), ()]
    assert set(missing) == {"b", "d", "e"}
    assert "van-0" in missing["b"]
