from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.arc_form.form import ArcForm
from dispatcher_daemon.planning.plans.candidates import Candidate, CandidateRefusal
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.energy.consumption import split_saving
from slipstream.errors import InputError
from slipstream_lab.research.cities.generator import small_city
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import (
    Form,
    arc_form_of,
    attempt,
    baseline,
    references_kwh,
    route_form_of,
)
from slipstream_lab.research.instances.instance import Instance
from slipstream_lab.research.instances.route_form import RouteForm


def outcome(*selected: int) -> Outcome:
    """A made-up answer."""
    return Outcome("made up", "feasible", frozenset(selected), 0.0)


@cache
def arcs() -> tuple[Instance, ArcForm]:
    """A published instance in which drafting pays."""
    instance = open_instance("arc25-03-avenue")
    return instance, arc_form_of(instance)


@cache
def options() -> tuple[Instance, RouteForm]:
    """A small city in route form."""
    city = small_city(1)
    return city, route_form_of(city)


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


def best_plan(form: Form) -> Candidate:
    """The exact answer as plans."""
    found = attempt(form, ExactSolver().solve(form.problem, 100.0, 1)).candidate
    assert found is not None
    return found


def plan_without_platooning(form: Form) -> tuple[str, Candidate]:
    """The plan without platooning."""
    name, alone = baseline(form, solve_in_process([ExactSolver()]), 10.0)
    assert isinstance(alone, Candidate)
    return name, alone


def test_arc_form_has_the_published_optimum() -> None:
    """What the form's problem costs at its optimum is what the file says."""
    instance, form = arcs()
    assert instance.optimum is not None
    found = ExactSolver().solve(form.problem, 10.0, 1)
    assert found.selected is not None
    assert form.problem.objective_kwh(found.selected) == pytest.approx(
        instance.optimum.objective_kwh, abs=1e-6
    )
    routes = {r.vehicle: tuple(v.place for v in r.visits[1:-1]) for r in best_plan(form).routes}
    assert routes == dict(instance.optimum.routes)


def test_a_plan_splits_what_drafting_saves() -> None:
    """Where the optimum platoons, drag is saved against the plan without; the parts add up."""
    _, form = arcs()
    name, alone = plan_without_platooning(form)
    assert name == "exact"
    plan = best_plan(form)
    saving = split_saving(alone.undrafted, plan.undrafted, plan.driven)
    assert plan.platooned_m > 0
    assert saving.drag_kwh > 0
    parts = saving.distance_kwh + saving.drag_kwh + saving.acceleration_kwh
    assert saving.total_kwh == pytest.approx(parts)


def test_an_answer_that_breaks_rules_becomes_no_plan() -> None:
    """The faults are named; of a solver without an answer, what it says."""
    _, form = arcs()
    tried = attempt(form, outcome(0, 1))
    assert tried.candidate is None
    assert tried.faults == ("van-b: does not leave depot",)
    silent = attempt(form, Outcome("made up", "timeout", None, 0.0, reason="too slow"))
    assert silent.faults == ("too slow",)


def test_missed_windows_and_overloads_are_refused() -> None:
    """What the arc form cannot see is looked at by the verifier of all plans."""
    instance, form = arcs()
    selected = ExactSolver().solve(form.problem, 10.0, 1).selected
    assert selected is not None
    short = replace(
        form,
        cycle=replace(form.cycle, problem=with_vehicles(form.cycle.problem, return_by_s=100.0)),
    )
    refused = short.candidate("exact", selected)
    assert isinstance(refused, CandidateRefusal)
    assert len(refused.faults) >= 2
    heavy = with_vehicles(with_demand(instance.problem, 3), capacity=5)
    overloaded = replace(form, cycle=replace(form.cycle, problem=heavy))
    refused = overloaded.candidate("exact", selected)
    assert isinstance(refused, CandidateRefusal)
    assert any("6" in fault and "5" in fault for fault in refused.faults)


@pytest.mark.nightly
def test_route_form_keeps_windows_and_serves_every_stop_once() -> None:
    """The optimum over the options breaks no rule on the road. By the model it costs no more than
    greedy; on the road it may, where three vehicles and more change at once, but hardly.
    """
    city, form = options()
    best = ExactSolver().solve(form.problem, 10.0, 1)
    name, _ = plan_without_platooning(form)
    plan = best_plan(form)
    assert name == "pyvrp"
    first = [options[0] for options in form.problem.options_of.values()]
    assert best.selected is not None
    assert form.problem.objective_kwh(best.selected) <= form.problem.objective_kwh(first) + 1e-9
    assert plan.objective_kwh <= 1.001 * min(references_kwh(form).values())
    served = [visit.place for route in plan.routes for visit in route.visits[1:-1]]
    assert sorted(served) == sorted(
        stop.id for stop in city.problem.fleet.stops if stop.id not in form.unserved
    )


@pytest.mark.long
def test_rewards_of_options_have_exact_entry_times() -> None:
    """An option fixes the departure, so that nothing is predicted at the earliest only."""
    _, form = options()
    assert form.judged
    assert all(arc.exact for arc in form.arcs)
    assert any(pair.saving_kwh > 0 for pair in form.judged)
    assert all((pair.reason is None) == (pair.saving_kwh > 0) for pair in form.judged)


@pytest.mark.long
def test_a_fleet_that_can_serve_nothing_is_bad_input() -> None:
    """Every stop too heavy for every vehicle: the error names instance, key and a reason."""
    city, _ = options()
    heavy = replace(city, problem=with_vehicles(with_demand(city.problem, 9), capacity=1))
    with pytest.raises(InputError, match="no stop can be served"):
        arc_form_of(heavy)
    with pytest.raises(InputError, match=r"fleet\.stops"):
        route_form_of(heavy)
