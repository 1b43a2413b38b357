from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome
from research.cities.generator import small_city
from research.instances import open_instance
from research.instances.instance import Instance
from research.solving.forms import ArcForm, RouteOptions, arc_form, route_form
from research.solving.trial import appraise, road_faults
from slipstream.errors import InputError


def outcome(*selected: int) -> Outcome:
    """A made-up answer."""
    return Outcome("made up", "feasible", frozenset(selected), 0.0)


@cache
def arcs() -> tuple[Instance, ArcForm]:
    """A published instance in which drafting pays."""
    instance = open_instance("arc25-03-avenue")
    return instance, arc_form(instance)


@cache
def options() -> tuple[Instance, RouteOptions]:
    """A small city in route form."""
    city = small_city(1)
    return city, route_form(city, 5, 1)


def with_vehicles(problem: RoutingProblem, **change: object) -> RoutingProblem:
    """The same with all vehicles changed."""
    fleet = problem.fleet
    vehicles = tuple(v.model_copy(update=change) for v in fleet.vehicles)
    return replace(problem, fleet=Fleet(depots=fleet.depots, stops=fleet.stops, vehicles=vehicles))


def with_demand(problem: RoutingProblem, demand: int) -> RoutingProblem:
    """The same with all stops of one demand."""
    fleet = problem.fleet
    stops = tuple(stop.model_copy(update={"demand": demand}) for stop in fleet.stops)
    return replace(problem, fleet=Fleet(depots=fleet.depots, stops=stops, vehicles=fleet.vehicles))


def test_arc_form_has_the_published_optimum() -> None:
    """What the form's problem costs at its optimum is what the file says."""
    instance, form = arcs()
    assert instance.optimum is not None
    found = ExactSolver().solve(form.problem, 10.0, 1)
    assert found.selected is not None
    assert form.objective_kwh(found.selected) == pytest.approx(
        instance.optimum.objective_kwh, abs=1e-6
    )
    routes = {
        r.vehicle: tuple(v.place for v in r.visits[1:-1]) for r in form.routes(found.selected)
    }
    assert routes == dict(instance.optimum.routes)


def test_a_trial_splits_what_drafting_saves() -> None:
    """Where the optimum platoons, drag is saved against the plan without; the parts add up."""
    instance, form = arcs()
    name, baseline = form.baseline(10.0, 1) or ("", [])
    assert "without platooning" in name
    best = ExactSolver().solve(form.problem, 10.0, 1)
    trial = appraise(form, instance.snapshot, instance.sync_window_s, best, baseline)
    assert trial.is_valid
    assert trial.saving is not None
    assert trial.energy is not None
    assert trial.platooned_m > 0
    assert trial.saving.drag_kwh > 0
    parts = trial.saving.distance_kwh + trial.saving.drag_kwh + trial.saving.acceleration_kwh
    assert trial.saving.total_kwh == pytest.approx(parts)


def test_an_answer_that_breaks_rules_is_not_appraised() -> None:
    """No routes, no energy, no objective for what is no route set; the faults are named."""
    instance, form = arcs()
    trial = appraise(form, instance.snapshot, instance.sync_window_s, outcome(0, 1), None)
    assert not trial.is_valid
    assert trial.faults
    assert (trial.objective_kwh, trial.energy, trial.routes) == (None, None, ())
    with pytest.raises(ValueError, match="van-a: "):
        form.routes({0})


def test_missed_windows_and_overloads_are_faults() -> None:
    """What the arc form cannot see is looked at on the road."""
    instance, form = arcs()
    best = ExactSolver().solve(form.problem, 10.0, 1).selected
    assert best is not None
    routes = form.routes(best)
    assert road_faults(form.routing, routes) == ()
    late = with_vehicles(instance.problem, return_by_s=10.0, ready_s=0.0)
    assert all("too late" in fault for fault in road_faults(late, routes))
    assert len(road_faults(late, routes)) == 2
    heavy = with_vehicles(with_demand(instance.problem, 3), capacity=5)
    faults = road_faults(heavy, routes)
    assert any("loads 6, more than its 5" in fault for fault in faults)


def test_route_form_evaluates_the_greedy_plan_as_it_is() -> None:
    """First options are the greedy plan: their exact objective is its own, from nothing."""
    _, form = options()
    first = {group[0] for group in form.problem.options_of.values() if group}
    assert form.objective_kwh(first) == pytest.approx(min(form.rivals_kwh().values()), abs=1e-9)


def test_route_form_keeps_windows_and_serves_every_stop_once() -> None:
    """The optimum over the options breaks no rule on the road. By the model it costs no more than
    greedy; on the road it may, where three vehicles and more change at once, but hardly.
    """
    city, form = options()
    best = ExactSolver().solve(form.problem, 10.0, 1)
    name, baseline = form.baseline(10.0, 1) or ("", [])
    trial = appraise(form, city.snapshot, city.sync_window_s, best, baseline)
    assert "PyVRP" in name
    assert trial.is_valid
    assert trial.objective_kwh is not None
    first = [options[0] for options in form.problem.options_of.values()]
    assert best.selected is not None
    assert form.problem.objective_kwh(best.selected) <= form.problem.objective_kwh(first) + 1e-9
    assert trial.objective_kwh <= 1.001 * min(form.rivals_kwh().values())
    served = [visit.place for route in trial.routes for visit in route.visits[1:-1]]
    assert sorted(served) == sorted(
        stop.id for stop in city.problem.fleet.stops if stop.id not in form.unserved
    )


def test_rewards_of_options_have_exact_entry_times() -> None:
    """An option fixes the departure, so that nothing is predicted at the earliest only."""
    _, form = options()
    assert form.judged
    assert all(arc.exact for arc in form.arcs)
    assert any(pair.saving_kwh > 0 for pair in form.judged)
    assert all((pair.reason is None) == (pair.saving_kwh > 0) for pair in form.judged)


def test_a_fleet_that_can_serve_nothing_is_bad_input() -> None:
    """Every stop too heavy for every vehicle: the error names instance, key and a reason."""
    city, _ = options()
    heavy = replace(city, problem=with_vehicles(with_demand(city.problem, 9), capacity=1))
    with pytest.raises(InputError, match="no stop can be served"):
        arc_form(heavy)
    with pytest.raises(InputError, match=r"fleet\.stops"):
        route_form(heavy, 5, 1)
