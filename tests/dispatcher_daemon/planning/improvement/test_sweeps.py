from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import pytest

from dispatcher_daemon.forms.problem import Problem, RouteProblem, RoutingProblem
from dispatcher_daemon.planning.improvement.options import add_discounted_ways
from dispatcher_daemon.planning.improvement.sweeps import BlockDescent, choice_of
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.routes import lateness_s
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.route_form.fleet_plan import initial_plans
from dispatcher_daemon.planning.routes.base_routes import base_routes
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome, Solver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream_lab.research.cities.generator import CityShape, generate_city

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
SETTINGS = CitySettings(max_sweeps=6, block_variables=16, options=4, wave=2)


@dataclass(frozen=True)
class Absurd:
    """Answers with a fixed selection, nothing, or an error."""

    selected: frozenset[int] | None
    name: str = "exact"
    raises: bool = False

    def warm_up(self) -> None:
        """Nothing to do."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """The same for every problem."""
        if self.raises:
            raise MemoryError("too large")
        return Outcome(self.name, "feasible", self.selected, 0.0)


@pytest.fixture(scope="module")
def start() -> tuple[Planner, list[Itinerary]]:
    """A city on one road network with many open gates, everybody leaving when ready."""
    city = generate_city(
        3, vehicles=12, stops=36, segments=160, shape=CityShape(depots=1, open_share=0.9)
    ).under("paper")
    travel = Travel(city.problem, roads_of(city.problem, city.snapshot))
    names = [stop.id for stop in city.problem.fleet.stops]
    search = SearchSettings(rounds=1, workers=1)
    with ThreadPoolExecutor(1) as thread:
        routes = base_routes(city.problem, travel, names, search, thread, 1)
    missing: dict[str, str] = {}
    settings = DispatcherSettings(city=SETTINGS)
    cycle = Cycle(city.problem, city.snapshot, settings, 1, 0, 1, reference_delay_s=10.0)
    first = initial_plans(cycle, travel, routes.stops, missing)
    add_discounted_ways(first.planner)
    assert not missing
    return first.planner, list(first.base.itineraries)


def sweep(
    start: tuple[Planner, list[Itinerary]], solvers: Sequence[Solver], seed: int = 1
) -> tuple[BlockDescent, list[float]]:
    """Sweeps to their end: (what it came to, objective at the start and after each)."""
    planner, itineraries = start
    names = tuple(solver.name for solver in solvers)
    settings = SETTINGS.model_copy(update={"solvers": names})
    descent = BlockDescent(planner, settings, solve_in_process(solvers), itineraries)
    sweeps, late = descent.run(seed, math.inf, time.monotonic)
    assert not late
    before = choice_of(planner, itineraries).objective_kwh
    return descent, [before, *(s.objective_kwh for s in sweeps)]


@pytest.mark.slow
def test_sweeps_improve_and_count_right(start: tuple[Planner, list[Itinerary]]) -> None:
    """No sweep makes the plan worse, the first makes it better, and the objective kept through all
    changes is that of the plan evaluated from nothing.
    """
    planner, itineraries = start
    descent, objectives = sweep(start, [ExactSolver()])
    assert objectives[1] < objectives[0] - 1e-4
    assert all(b <= a + 1e-12 for a, b in pairwise(objectives))
    assert choice_of(planner, descent.present).objective_kwh == pytest.approx(
        objectives[-1], abs=1e-9
    )
    assert [i.number for i in descent.present] == list(range(len(itineraries)))


@pytest.mark.slow
def test_sweeps_keep_windows_and_stops(start: tuple[Planner, list[Itinerary]]) -> None:
    """Every vehicle serves what it served, leaves within its window and is late nowhere."""
    planner, itineraries = start
    descent, _ = sweep(start, [ExactSolver()])
    moved = 0
    for before, after in zip(itineraries, descent.present, strict=True):
        assert sorted(after.stops) == sorted(before.stops)
        moved += after.key != before.key
        if after.route is not None:
            vehicle = planner.problem.fleet.vehicles[after.number]
            assert lateness_s(planner.problem, vehicle, after.route, 10.0) <= 1e-6
    assert moved > 0


@pytest.mark.slow
@pytest.mark.parametrize(("variables", "options"), [(25, 2), (4, 2)])
def test_blocks_are_no_larger_than_allowed(
    start: tuple[Planner, list[Itinerary]], variables: int, options: int
) -> None:
    """No solver is given more variables than the settings say."""
    planner, itineraries = start
    settings = SETTINGS.model_copy(update={"block_variables": variables, "options": options})
    descent = BlockDescent(planner, settings, solve_in_process([ExactSolver()]), itineraries)
    sweeps, _ = descent.run(1, math.inf, time.monotonic)
    assert 0 < max(s.largest for s in sweeps) <= variables
    assert all(s.variables <= s.blocks * variables for s in sweeps)
    assert all(len(s.outcomes) == s.blocks for s in sweeps)


@pytest.mark.slow
@pytest.mark.parametrize(
    "absurd",
    [
        Absurd(None),
        Absurd(frozenset({99})),
        Absurd(None, raises=True),
    ],
)
def test_a_solver_that_fails_costs_nothing_but_improvement(
    start: tuple[Planner, list[Itinerary]], absurd: Absurd
) -> None:
    """No answer, an absurd one, an error: alone the plan stays; beside it the other's counts."""
    planner, itineraries = start
    descent, objectives = sweep(start, [absurd])
    assert descent.present == itineraries
    assert len(set(objectives)) == 1
    assert len(objectives) == 1 + SETTINGS.patience
    beside = Absurd(absurd.selected, "tabu", absurd.raises)
    both, objectives = sweep(start, [beside, ExactSolver()])
    assert objectives[-1] < objectives[0]
    assert choice_of(planner, both.present).objective_kwh == pytest.approx(objectives[-1])


def test_answers_that_look_better_in_the_block_only_are_not_taken(
    start: tuple[Planner, list[Itinerary]],
) -> None:
    """Any valid answer, however bad, leaves the plan no worse: here every vehicle's last option."""

    @dataclass(frozen=True)
    class Contrary:
        name: str = "exact"

        def warm_up(self) -> None:
            """Nothing to do."""

        def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
            """All vehicles change at once."""
            assert isinstance(problem, RouteProblem)
            last = frozenset(of_one[-1] for of_one in problem.options_of.values())
            return Outcome(self.name, "feasible", last, 0.0)

    planner, _ = start
    descent, objectives = sweep(start, [Contrary()])
    assert all(b <= a + 1e-12 for a, b in pairwise(objectives))
    assert choice_of(planner, descent.present).objective_kwh == pytest.approx(objectives[-1])


def test_a_time_that_is_up_ends_the_sweeps(start: tuple[Planner, list[Itinerary]]) -> None:
    """Not a block is asked for after the end, and that time ran out is said."""
    planner, itineraries = start
    descent = BlockDescent(
        planner, SETTINGS, solve_in_process([Absurd(None, raises=True)]), itineraries
    )
    sweeps, late = descent.run(1, 10.0, lambda: 10.0)
    assert (sweeps, late) == ((), True)
    assert descent.present == itineraries


def criss_cross(town: Town, *, badly: bool) -> tuple[BlockDescent, dict[str, tuple[str, ...]]]:
    """Two vans that each serve both corners, and routes with one for each; or the reverse."""
    problem, snapshot = town(["30", "03", "30", "03", "33"], [{}, {"ready_s": 600.0}, {}])
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    crossed = {"van-0": ("s0", "s1"), "van-1": ("s2", "s3"), "van-2": ("s4",)}
    direct = {"van-0": ("s0", "s2"), "van-1": ("s1", "s3"), "van-2": ("s4",)}
    present, other = (crossed, direct) if badly else (direct, crossed)
    itineraries = []
    for number, stops in enumerate(present.values()):
        itinerary = planner.itinerary(number, stops, planner.legs(number, stops))
        assert itinerary is not None
        itineraries.append(itinerary)
    return BlockDescent(planner, SETTINGS, solve_in_process([ExactSolver()]), itineraries), other


@pytest.mark.parametrize("variables", [3, 25])
def test_exchanges_are_taken_if_they_are_better(town: Town, variables: int) -> None:
    """Stops change hands all at once, whether the exchange fits a block or not."""
    descent, other = criss_cross(town, badly=True)
    descent.settings = SETTINGS.model_copy(update={"block_variables": variables})
    before = choice_of(descent.planner, descent.present).objective_kwh
    assert descent.adopt(other, 1, math.inf, time.monotonic) == 1
    assert {f"van-{i.number}": i.stops for i in descent.present} == other
    after = choice_of(descent.planner, descent.present).objective_kwh
    assert after < before
    sweeps, _ = descent.run(1, math.inf, time.monotonic)
    swept = choice_of(descent.planner, descent.present).objective_kwh
    assert sweeps[-1].objective_kwh == pytest.approx(swept)


def test_worse_exchanges_are_not_taken(town: Town) -> None:
    """The same the other way round: nothing changes, on the road either; nor after the end."""
    descent, other = criss_cross(town, badly=False)
    before = list(descent.present)
    assert descent.adopt(other, 1, math.inf, time.monotonic) == 0
    assert descent.present == before
    descent.settings = SETTINGS.model_copy(update={"block_variables": 3})
    assert descent.adopt(other, 1, math.inf, time.monotonic) == 0
    assert descent.present == before
    better, other = criss_cross(town, badly=True)
    assert better.adopt(other, 1, 5.0, lambda: 6.0) == 0


def test_an_exchange_that_misses_a_window_is_left_alone(town: Town) -> None:
    """A route that its van cannot keep is no exchange, and leaves everybody where they were."""
    early = {"id": "early", "node": "33", "latest_s": 200.0}
    problem, snapshot = town([early, "30"], [{}, {"ready_s": 150.0}])
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    itineraries = []
    for number, stops in enumerate((("early",), ("s1",))):
        itinerary = planner.itinerary(number, stops, planner.legs(number, stops))
        assert itinerary is not None
        itineraries.append(itinerary)
    descent = BlockDescent(planner, SETTINGS, solve_in_process([ExactSolver()]), itineraries)
    other: dict[str, tuple[str, ...]] = {"van-0": ("s1",), "van-1": ("early",)}
    assert descent.adopt(other, 1, math.inf, time.monotonic) == 0
    assert descent.present == itineraries
    sweeps, _ = descent.run(1, math.inf, time.monotonic)
    assert sweeps[-1].objective_kwh == pytest.approx(
        choice_of(planner, descent.present).objective_kwh
    )
