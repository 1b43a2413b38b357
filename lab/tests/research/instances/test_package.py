"""Instances for a benchmark library: its checker knows what `slipstream verify` knows, alone."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from itertools import combinations, pairwise, permutations
from pathlib import Path

import numpy as np
import pytest

from dispatcher_daemon.forms import decode
from dispatcher_daemon.forms.problem import ArcProblem
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.catalogue import CATALOGUE
from slipstream_lab.research.instances.check_vrpcp import (
    TOLERANCE,
    Invalid,
    VrpcpInstance,
    check_solution,
    main,
)
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.instances.package import (
    CHECKER,
    instance_text,
    solution_text,
    write_package,
)
from slipstream_lab.research.proofs.proof import prove

SMALL = ("arc06-valley", "arc14-avenue", "arc20-motorway")
MUTATIONS = 1000

Routes = dict[int, list[int]]


@cache
def problem_of(name: str) -> ArcProblem:
    """The arc form of a published instance."""
    return arc_form_of(open_instance(name)).problem


@cache
def text_of(name: str) -> str:
    """Its file."""
    return instance_text(open_instance(name), problem_of(name))


def all_routes(problem: ArcProblem) -> Iterator[Routes]:
    """Each order of all customers, cut into a route of at least one customer for each vehicle."""
    count, vehicles = len(problem.customers), len(problem.vehicles)
    for order in permutations(range(1, count + 1)):
        for cuts in combinations(range(1, count), vehicles - 1):
            ends = pairwise((0, *cuts, count))
            yield {k: list(order[a:b]) for k, (a, b) in enumerate(ends, 1)}


def as_text(routes: Routes, cost: object) -> str:
    """A solution file."""
    lines = [f"Route #{k}: {' '.join(map(str, stops))}" for k, stops in routes.items()]
    return "\n".join([*lines, f"Cost {cost}"]) + "\n"


def true_objective(problem: ArcProblem, routes: Routes) -> float | None:
    """By the dispatcher's own rules; None if the routes break one."""
    customers = dict(enumerate(problem.customers, 1))
    if set(routes) != set(range(1, len(problem.vehicles) + 1)):
        return None
    if any(stop not in customers for stops in routes.values() for stop in stops):
        return None
    named = {
        vehicle: tuple(customers[i] for i in routes[k])
        for k, vehicle in enumerate(problem.vehicles, 1)
    }
    selected = None if not all(named.values()) else problem.selection(named)
    if selected is None or decode(problem, selected).routes != named:
        return None
    return problem.objective_kwh(selected)


def agree(name: str) -> None:
    """Number of valid route sets and least objective are those of the enumerated QUBO."""
    problem, instance = problem_of(name), VrpcpInstance(text_of(name))
    found = []
    for routes in all_routes(problem):
        try:
            found.append(instance.objective(routes))
        except Invalid:
            continue
    proof = prove(problem)
    assert proof.holds
    assert len(found) == proof.found.valid_selections
    assert min(found) == pytest.approx(proof.found.minimum_kwh, abs=1e-9)
    known = open_instance(name).known
    assert known is not None
    assert check_solution(instance, solution_text(problem, known)) == pytest.approx(min(found))


def mutated(routes: Routes, cost: float, customers: int, rng: np.random.Generator) -> str:
    """The solution with one fault or two."""
    changed = {k: list(stops) for k, stops in routes.items()}
    for _ in range(rng.integers(1, 3)):
        vehicle = int(rng.choice(list(changed)))
        stops = changed[vehicle]
        at = int(rng.integers(0, len(stops) + 1))
        kind = rng.integers(0, 7)
        if kind == 0 and stops:
            stops.pop(min(at, len(stops) - 1))
        elif kind == 1:
            stops.insert(at, int(rng.integers(0, customers + 2)))
        elif kind == 2 and stops:
            stops[min(at, len(stops) - 1)] = int(rng.integers(0, customers + 2))
        elif kind == 3:
            rng.shuffle(stops)
        elif kind == 4:
            changed[vehicle + 1] = changed.pop(vehicle)
        elif kind == 5:
            other = int(rng.choice(list(changed)))
            changed[vehicle], changed[other] = changed[other], changed[vehicle]
        else:
            cost += float(rng.choice([-1, 1])) * float(10 ** rng.uniform(-5.5, 1))
    return as_text(changed, repr(cost))


def reject(name: str, seed: int, least: int) -> None:
    """Of answers that break a rule or state another cost, none passes."""
    problem, instance = problem_of(name), VrpcpInstance(text_of(name))
    known = open_instance(name).known
    assert known is not None
    best = {k: list(known.routes[v]) for k, v in enumerate(problem.vehicles, 1)}
    places = {c: i for i, c in enumerate(problem.customers, 1)}
    routes = {k: [places[str(stop)] for stop in stops] for k, stops in best.items()}
    rng = np.random.default_rng(seed)
    wrong = 0
    while wrong < least:
        text = mutated(routes, known.objective_kwh, len(problem.customers), rng)
        *lines, last = text.splitlines()
        given = {
            int(line[7 : line.index(":")]): [int(word) for word in line.split()[2:]]
            for line in lines
        }
        truth = true_objective(problem, given)
        if truth is not None and abs(truth - float(last.split()[1])) <= TOLERANCE:
            assert check_solution(instance, text) == pytest.approx(truth, abs=1e-9)
            continue
        wrong += 1
        with pytest.raises(Invalid):
            check_solution(instance, text)


@pytest.mark.parametrize("name", SMALL[:2])
def test_the_checker_agrees_with_the_proof(name: str) -> None:
    """On small instances; on all of them below."""
    agree(name)


@pytest.mark.long
@pytest.mark.parametrize("name", list(CATALOGUE))
def test_the_checker_agrees_with_the_proof_on_each_published_instance(name: str) -> None:
    """And rejects a thousand wrong answers to each."""
    agree(name)
    reject(name, 7, MUTATIONS)


@pytest.mark.parametrize("name", SMALL)
def test_the_checker_rejects_a_thousand_wrong_answers(name: str) -> None:
    """Those of them that happen to be right are accepted."""
    reject(name, 1, MUTATIONS)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda text: text.replace("Cost", "Price"), "line 3 is neither"),
        (lambda text: text.rpartition("Cost")[0], "no line 'Cost N'"),
        (lambda text: text + text.splitlines()[-1], "a second cost"),
        (lambda text: text + text.splitlines()[0], "a second route of vehicle 1"),
        (lambda text: text.rpartition(" ")[0] + " nan", "'nan' is no number"),
        (lambda text: "", "vehicle 1 has no route"),
    ],
    ids=["word", "no-cost", "two-costs", "two-routes", "nan", "empty"],
)
def test_a_file_that_is_no_solution_is_invalid(change: object, problem: str) -> None:
    """Whatever cannot be read breaks a rule."""
    assert callable(change)
    name = "arc14-avenue"
    known = open_instance(name).known
    assert known is not None
    text = solution_text(problem_of(name), known)
    with pytest.raises(Invalid, match=problem):
        check_solution(VrpcpInstance(text_of(name)), change(text))


def test_a_damaged_instance_is_the_callers_mistake(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line that is missing is noticed, with exit status 2 and one line."""
    text = text_of("arc25-01-avenue")
    instance, solution = tmp_path / "a.vrpcp", tmp_path / "a.sol"
    solution.write_text("Cost 1\n")
    lines = text.splitlines()
    for cut in range(len(lines) - 1):
        instance.write_text("\n".join([*lines[:cut], *lines[cut + 1 :]]) + "\n")
        free = lines[cut].startswith(("NAME", "COMMENT", "LICENCE", "OBJECTIVE", "BEST"))
        assert main([str(instance), str(solution)]) == (1 if free else 2), lines[cut]
    assert capsys.readouterr().err.count("\n") == len(lines) - 1 - 5


@pytest.mark.process
def test_the_package_checks_itself_without_our_code(tmp_path: Path) -> None:
    """The checker runs with no installed package, and says what the optimum is."""
    paths = write_package([open_instance("arc14-avenue")], tmp_path)
    assert all(path.is_file() for path in paths)
    done = subprocess.run(
        [
            *(sys.executable, "-I", "-S", str(tmp_path / "check" / CHECKER)),
            str(tmp_path / "instances" / "arc14-avenue.vrpcp"),
            str(tmp_path / "solutions" / "arc14-avenue.opt.sol"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    known = open_instance("arc14-avenue").known
    assert known is not None
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"valid: objective {known.objective_kwh:.9f} kWh\n"
