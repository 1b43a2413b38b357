from __future__ import annotations

import time
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from dispatcher_daemon.forms.arc import ArcVariable, OrderBit, SlackBit, build_arc_model
from dispatcher_daemon.forms.decode import decode
from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.problem import ArcProblem
from dispatcher_daemon.planning.arc_form.arcs import arc_problem_of
from dispatcher_daemon.planning.plans import Candidate
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import PoolJob, solve_in_process
from slipstream.errors import InputError
from slipstream_lab.research.instances import instance_names, open_instance
from slipstream_lab.research.instances.catalogue import CATALOGUE
from slipstream_lab.research.instances.forms import arc_form_of, attempt, baseline
from slipstream_lab.research.instances.generator import generate
from slipstream_lab.research.instances.instance import load_instance, write_instance
from slipstream_lab.research.instances.publish import make_instance
from slipstream_lab.research.proofs.proof import prove

OF_25 = [name for name in CATALOGUE if name.startswith("arc25-")]


@cache
def arcs_of(name: str) -> ArcProblem:
    """The arc form of a published instance."""
    instance = open_instance(name)
    return arc_problem_of(instance.problem, instance.snapshot, instance.sync_window_s)


def test_what_is_published_is_the_catalogue() -> None:
    """A file for each name and no other; twenty of them of 25 variables."""
    assert set(instance_names()) == set(CATALOGUE)
    assert len(OF_25) == 20


@pytest.mark.parametrize("name", OF_25)
def test_25_active_variables(name: str) -> None:
    """16 arcs, 8 order bits and 1 slack bit, none of them idle."""
    model = build_arc_model(arcs_of(name))
    kinds = Counter(type(variable) for variable in model.variables)
    assert kinds == {ArcVariable: 16, OrderBit: 8, SlackBit: 1}
    assert {v for pair in model.penalty.quadratic for v in pair} == set(model.variables)


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_published_optima_are_optima(name: str) -> None:
    """HiGHS finds the published objective, and the published routes have it."""
    instance, problem = open_instance(name), arcs_of(name)
    known, exact = instance.optimum, solve_milp(problem, 30.0)
    assert instance.name == name
    assert f"{name!r}" in instance.provenance
    assert known is not None
    assert (known.form, known.proven) == ("arc", True)
    assert exact.objective_kwh == pytest.approx(known.objective_kwh, abs=2e-9)
    selected = problem.selection(known.routes)
    assert selected is not None
    assert decode(problem, selected).routes == known.routes
    assert problem.objective_kwh(selected) == pytest.approx(known.objective_kwh, abs=2e-9)


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_optima_of_the_energy_need_no_more_energy_and_promise_no_more(name: str) -> None:
    """Under the objective "energy" HiGHS finds the published optimum. Driven, it needs no more than
    the plan without platooning, and drafting saves what is counted but for changes of speed.
    """
    instance = open_instance(name).under("energy")
    form, known = arc_form_of(instance), instance.known
    assert known is not None
    solve = solve_in_process([ExactSolver()])
    (outcome,) = solve([PoolJob("exact", form.problem, 1)], 30.0)
    plan, (_, alone) = attempt(form, outcome).candidate, baseline(form, solve, 30.0)
    assert plan is not None
    assert outcome.selected is not None
    found = form.problem.objective_kwh(outcome.selected)
    assert found == pytest.approx(known.objective_kwh, abs=2e-9)
    assert isinstance(alone, Candidate)
    assert plan.driven.total_kwh <= alone.driven.total_kwh + 1e-9
    promised = form.problem.without_platooning().objective_kwh(outcome.selected) - found
    saved = plan.undrafted.total_kwh - plan.driven.total_kwh
    # Pairs count more than a leader and its followers save where a platoon has three.
    assert saved >= 0.5 * promised - 1e-8


def test_platooning_changes_the_routes_of_most() -> None:
    """Twelve of the twenty have other routes than without rewards; three have no rewards."""
    changed = 0
    for name in OF_25:
        problem = arcs_of(name)
        plain = problem.without_platooning()
        alone, together = solve_milp(plain, 30.0).selected, solve_milp(problem, 30.0).selected
        assert alone is not None
        assert together is not None
        wanted = CATALOGUE[name][0].flips
        assert wanted in (None, alone != together)
        changed += plain.objective_kwh(together) > plain.objective_kwh(alone) + 5e-5
    assert changed == 12
    assert sum(not arcs_of(name).rewards for name in OF_25) == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arc25-05-ring", "arc25-17-valley"])
def test_a_published_instance_is_exact(name: str) -> None:
    """All 2^25 states, by the computed γ; within the 5 s that it may take, of processor time."""
    began = time.process_time()
    found = prove(arcs_of(name))
    assert time.process_time() - began < 5.0
    assert found.found.states == 2**25
    assert found.holds


@pytest.mark.parametrize("name", ["arc06-valley", "arc14-motorway", "arc15-ring", "arc20-motorway"])
def test_the_generator_writes_the_published_file(name: str, tmp_path: Path) -> None:
    """Recipe and seed give what is published, to the byte."""
    path = tmp_path / f"{name}.json"
    write_instance(make_instance(name), path)
    files = Path(__file__).parents[3] / "slipstream_lab" / "research" / "instances" / "files"
    assert path.read_bytes() == (files / path.name).read_bytes()
    assert load_instance(path) == open_instance(name)


@pytest.mark.parametrize("name", ["arc25-05-ring", "arc25-08-bridges", "arc25-18-motorway"])
def test_recipe_and_seed_give_the_published_problem(name: str) -> None:
    """The same roads, fleet and traffic, draw by draw."""
    drawn = generate(*CATALOGUE[name])
    assert arc_problem_of(drawn.problem, drawn.snapshot, 3.0) == arcs_of(name)
    assert f"draw {drawn.draw})" in open_instance(name).provenance


def test_another_seed_gives_another_instance() -> None:
    """The seed is not for show."""
    recipe, seed = CATALOGUE["arc15-ring"]
    assert generate(recipe, seed + 1).problem != generate(recipe, seed).problem


def test_names_and_files_that_are_not_there_are_named(tmp_path: Path) -> None:
    """The error says which and where names are listed."""
    with pytest.raises(InputError, match="arc99: no instance of this name; see slipstream solve"):
        open_instance("arc99")
    with pytest.raises(InputError, match="no such file"):
        open_instance(tmp_path / "mine.json")
