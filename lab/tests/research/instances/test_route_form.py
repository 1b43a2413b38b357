from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import combinations

import pytest

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.planning.improvement.sweeps import choice_of
from dispatcher_daemon.planning.plans.candidates import Candidate, CandidateRefusal
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from slipstream_lab.research.cities.generator import CityShape, generate_city
from slipstream_lab.research.instances.forms import instance_cycle
from slipstream_lab.research.instances.route_form import RouteForm, route_form

SETTINGS = CitySettings(
    search=SearchSettings(rounds=2, iterations_per_stop=5, workers=1), options=4
)


@cache
def form() -> RouteForm:
    """Five vans at one depot, in calm traffic."""
    city = generate_city(
        2, vehicles=5, stops=14, segments=100, shape=CityShape(depots=1, open_share=1.0)
    )
    cycle = instance_cycle(city, 1, DispatcherSettings(city=SETTINGS))
    with ThreadPoolExecutor(1) as thread:
        return route_form(cycle, thread)


def test_every_driving_vehicle_has_a_few_options() -> None:
    """The present one, others over the same stops, and exchanges; nobody is left out who drives in
    the greedy plan, and nothing is said twice of one vehicle's own stops.
    """
    made = form()
    driving = {i.number for i in made.first.greedy.itineraries if i.route is not None}
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
    first = made.first
    begin = choice_of(first.planner, made.block.chosen(stay)).objective_kwh
    assert begin == pytest.approx(min(first.base.objective_kwh, first.greedy.objective_kwh))
    for k, m in combinations(range(len(groups)), 2):
        selected = stay - {groups[k][0], groups[m][0]} | {groups[k][-1], groups[m][-1]}
        exact = choice_of(made.first.planner, made.block.chosen(selected)).objective_kwh - begin
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
    assert visits == sorted(stop for i in made.first.greedy.itineraries for stop in i.stops)
    stay = {group[0] for group in problem.options_of.values()}
    assert problem.objective_kwh(answer) <= problem.objective_kwh(stay) + 1e-9


def test_an_answer_becomes_verified_plans_or_a_refusal() -> None:
    """The exact answer passes the verifier that each cycle's plans pass; what is no choice of one
    option a vehicle is refused with the rules that it breaks.
    """
    made = form()
    answer = ExactSolver().solve(made.problem, 10.0, 1).selected
    assert answer is not None
    found = made.candidate("exact", answer)
    assert isinstance(found, Candidate)
    assert len(found.plans) == len(found.routes) == len(found.energies)
    first = next(iter(answer))
    refused = made.candidate("exact", answer - {first})
    assert isinstance(refused, CandidateRefusal)
    assert refused.faults
    unknown = made.candidate("exact", frozenset({made.problem.choices}))
    assert unknown == CandidateRefusal(("not a selection of options",))
