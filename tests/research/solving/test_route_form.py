from __future__ import annotations

from functools import cache
from itertools import combinations

import pytest

from dispatcher_daemon.formulations.decode import violations
from dispatcher_daemon.planning.sweeps import choice_of
from dispatcher_daemon.settings import CitySettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from research.cities.generator import CityShape, generate_city
from research.solving.route_form import RouteForm, route_problem_of

SETTINGS = CitySettings(
    search=SearchSettings(rounds=2, iterations_per_stop=5, workers=1), options=4
)


@cache
def form() -> RouteForm:
    """Five vans at one depot, in calm traffic."""
    city = generate_city(
        2, vehicles=5, stops=14, segments=100, shape=CityShape(depots=1, open_share=1.0)
    )
    return route_problem_of(city.problem, city.snapshot, SETTINGS, sync_window_s=3.0, seed=1)


def test_every_driving_vehicle_has_a_few_options() -> None:
    """The present one, others over the same stops, and exchanges; nobody is left out who drives in
    the greedy plan, and nothing is said twice of one vehicle's own stops.
    """
    made = form()
    driving = {i.number for i in made.greedy.itineraries if i.route is not None}
    assert set(made.block.options) == driving
    for number, of_one in made.block.options.items():
        own = [o.key for o in of_one if sorted(o.stops) == sorted(of_one[0].stops)]
        assert 2 <= len(own) <= SETTINGS.options
        assert len(set(own)) == len(own)
        assert {o.number for o in of_one} == {number}
    assert made.block.problem.choices == sum(map(len, made.block.options.values()))
    assert made.unserved == {}


def test_the_first_options_are_the_plan_to_begin_with() -> None:
    """They are the better of base and greedy, and two changes at once are still exact."""
    made = form()
    problem = made.block.problem
    groups = list(problem.options_of.values())
    stay = frozenset(group[0] for group in groups)
    begin = choice_of(made.planner, made.block.chosen(stay)).objective_kwh
    assert begin == pytest.approx(min(made.base.objective_kwh, made.greedy.objective_kwh))
    for k, m in combinations(range(len(groups)), 2):
        selected = stay - {groups[k][0], groups[m][0]} | {groups[k][-1], groups[m][-1]}
        exact = choice_of(made.planner, made.block.chosen(selected)).objective_kwh - begin
        change = problem.objective_kwh(selected) - problem.objective_kwh(stay)
        assert change == pytest.approx(exact, abs=1e-12)


def test_exchanges_are_covered_once_in_any_answer() -> None:
    """Stops that change hands are in question, and the exact answer serves each stop once, for no
    more than the plan to begin with.
    """
    made = form()
    problem = made.block.problem
    assert problem.stops
    answer = ExactSolver().solve(problem, 10.0, 1).selected
    assert answer is not None
    assert violations(problem, answer) == ()
    chosen = made.block.chosen(answer)
    visits = sorted(stop for i in chosen for stop in i.stops)
    assert visits == sorted(stop for i in made.greedy.itineraries for stop in i.stops)
    stay = {group[0] for group in problem.options_of.values()}
    assert problem.objective_kwh(answer) <= problem.objective_kwh(stay) + 1e-9
