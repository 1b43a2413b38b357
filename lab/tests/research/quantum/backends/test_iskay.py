"""Iskay against a stand-in that answers as its documentation says, or does not."""

from __future__ import annotations

import ast
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.milp import solve_milp
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.problem import RouteOption, RouteProblem
from dispatcher_daemon.solvers.quantum.backends import AccountAccess
from slipstream_lab.research.quantum.backends.iskay import (
    IskaySolver,
    qubo_terms,
    solution_bits,
)

Routes = Callable[..., RouteProblem]

SECRET = "secret-token-1"


def energy(terms: Mapping[str, float], values: Mapping[int, int]) -> float:
    """The polynomial that the documented keys stand for."""
    return sum(
        value * int(np.prod([values[i] for i in ast.literal_eval(key)]))
        for key, value in terms.items()
    )


def documented(terms: Mapping[str, float], seed: int = 1) -> dict[str, Any]:
    """The best state, in the form of the documented answer with the bits in another order."""
    labels = sorted({i for key in terms for i in ast.literal_eval(key)})
    states = (dict(zip(labels, bits, strict=True)) for bits in product((0, 1), repeat=len(labels)))
    best = min(states, key=lambda values: energy(terms, values))
    order = np.random.default_rng(seed).permutation(labels).tolist()
    return {
        "solution": {str(i): value for i, value in best.items()},
        "solution_info": {
            "bitstring": "".join(str(best[i]) for i in order),
            "cost": energy(terms, best),
            "seed_transpiler": 42,
            "mapping": dict(enumerate(order)),
        },
        "prob_type": "binary",
    }


@dataclass
class StandIn:
    """The catalogue, its function and its only job in one.

    Attributes:
        statuses: told one after the other; the last for ever.
        result_of: makes the answer from the problem; None: as documented.
        hangs: name of the call that never returns.
        error: raised by the run.
    """

    statuses: list[str] = field(default_factory=lambda: ["QUEUED", "RUNNING: WAITING_QPU", "DONE"])
    result_of: Callable[[dict[str, Any]], Any] | None = None
    hangs: str | None = None
    error: Exception | None = None
    known: bool = True
    job_id: str = "job-7"
    asked: list[dict[str, Any]] = field(default_factory=list)
    taken_up: list[str] = field(default_factory=list)
    asked_for: list[AccountAccess] = field(default_factory=list)

    def open(self, access: AccountAccess) -> StandIn:
        """The catalogue for an account."""
        self.asked_for.append(access)
        return self

    def load(self, name: str) -> StandIn | None:
        """The function."""
        assert name == "kipu-quantum/iskay-quantum-optimizer"
        return self if self.known else None

    def run(self, **arguments: Any) -> StandIn:
        """Start the job."""
        self._maybe_hang("run")
        if self.error is not None:
            raise self.error
        self.asked.append(arguments)
        return self

    def job(self, job_id: str) -> StandIn:
        """An earlier job."""
        self.taken_up.append(job_id)
        return self

    def status(self) -> str:
        """State of the job."""
        self._maybe_hang("status")
        return self.statuses.pop(0) if len(self.statuses) > 1 else self.statuses[0]

    def error_message(self) -> str:
        """Why it failed."""
        return f"4600: function size too small (token {SECRET})"

    def result(self, wait: bool = True) -> Any:
        """The answer."""
        assert not wait, "must not wait for ever"
        self._maybe_hang("result")
        problem = self.asked[0]["problem"] if self.asked else {}
        answer = documented(problem) if problem else None
        return answer if self.result_of is None else self.result_of(answer or {})

    def _maybe_hang(self, call: str) -> None:
        if self.hangs == call:
            threading.Event().wait(30.0)


def solver(service: StandIn, **changes: Any) -> IskaySolver:
    """The solver in front of a stand-in."""
    return IskaySolver(
        AccountAccess(SECRET, "crn:1"), "ibm_boston", catalog=service.open, poll_s=0.01, **changes
    )


@pytest.fixture
def problem(random_routes: Routes) -> RouteProblem:
    """Six options of three vehicles, solvable."""
    made = random_routes(3, [2, 2, 2], 2)
    assert solve_milp(made, 5.0).selected is not None
    return made


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_terms_have_the_models_energy_and_bits_come_back_by_variable(
    random_routes: Routes, seed: int
) -> None:
    """Every state has the same energy in both, and the best state finds its variables again."""
    model = build_model(random_routes(seed, [2, 3], 2))
    terms, names = qubo_terms(model), list(model.variables)
    assert all(isinstance(ast.literal_eval(key), tuple) for key in terms)
    best = min(
        product((0, 1), repeat=5),
        key=lambda bits: model.total.energy(dict(zip(names, bits, strict=True))),
    )
    for bits in product((0, 1), repeat=5):
        ours = model.total.energy(dict(zip(names, bits, strict=True)))
        assert energy(terms, dict(enumerate(bits))) == pytest.approx(ours)
    found = solution_bits(documented(terms, seed), 5)[0]
    energies = [model.total.energy(dict(zip(names, bits, strict=True))) for bits in (best, found)]
    assert energies[0] == pytest.approx(energies[1])


def test_the_documented_call_and_its_answer(problem: RouteProblem) -> None:
    """The optimum comes back through the service, with job id and without shares of shots."""
    service = StandIn()
    outcome = solver(service, shots=500, iterations=3).solve(problem, 10.0, 7)
    exact = solve_milp(problem, 5.0)
    assert outcome.status == "feasible"
    assert outcome.selected is not None
    assert problem.objective_kwh(outcome.selected) == pytest.approx(exact.objective_kwh)
    assert not outcome.repaired
    assert outcome.samples is None
    assert outcome.execution is not None
    assert (outcome.execution.job, outcome.execution.backend) == ("job-7", "ibm:ibm_boston")
    assert outcome.execution.kind == "hardware"
    (asked,) = service.asked
    assert (asked["problem_type"], asked["backend_name"]) == ("binary", "ibm_boston")
    assert asked["options"] == {
        "shots": 500,
        "num_iterations": 3,
        "seed_transpiler": 7,
        "job_tags": ["slipstream"],
    }
    assert service.asked_for == [AccountAccess(SECRET, "crn:1")]


def test_a_cost_that_is_a_lie_changes_nothing(
    problem: RouteProblem, caplog: pytest.LogCaptureFixture
) -> None:
    """A poor solution that is praised is what our own evaluation makes of it, and that is said."""

    def praised(answer: dict[str, Any]) -> dict[str, Any]:
        string = "0" * len(answer["solution"])
        info = answer["solution_info"] | {"bitstring": string, "cost": -1e6}
        return {"solution": dict.fromkeys(answer["solution"], 0), "solution_info": info}

    outcome = solver(StandIn(result_of=praised)).solve(problem, 10.0, 1)
    assert outcome.repaired or outcome.selected is None
    assert "-1000000" in caplog.text


@pytest.mark.slow
def test_a_late_job_keeps_its_id_and_is_taken_up_later(problem: RouteProblem) -> None:
    """At the deadline the outcome names the job; a solver with that id asks for no second one."""
    service = StandIn(statuses=["QUEUED"])
    outcome = solver(service).solve(problem, 1.0, 1)
    assert (outcome.status, outcome.selected) == ("timeout", None)
    assert "--job job-7" in (outcome.reason or "")
    assert outcome.execution is not None
    assert outcome.execution.job == "job-7"
    service.statuses[:] = ["DONE"]
    again = solver(service, job="job-7").solve(problem, 5.0, 1)
    assert again.status == "feasible"
    assert service.taken_up == ["job-7"]
    assert len(service.asked) == 1


@pytest.mark.long
@pytest.mark.parametrize("hangs", ["run", "status", "result"])
def test_a_service_that_hangs_does_not_hold_the_solver(problem: RouteProblem, hangs: str) -> None:
    """Whichever call never returns, the deadline is kept."""
    began = time.perf_counter()
    outcome = solver(StandIn(hangs=hangs)).solve(problem, 1.0, 1)
    assert time.perf_counter() - began < 10.0
    assert outcome.status == "timeout"
    assert (outcome.execution is None) == (hangs == "run")


@pytest.mark.parametrize(
    ("service", "said"),
    [
        (StandIn(statuses=["ERROR"]), "4600"),
        (StandIn(statuses=["RUNNING", "CANCELED"]), "cancelled"),
        (StandIn(error=RuntimeError(f"401 bad token {SECRET}")), "401"),
        (StandIn(known=False), "may not run"),
    ],
)
def test_a_job_that_fails_says_why_without_the_token(
    problem: RouteProblem, service: StandIn, said: str
) -> None:
    """Refused, failed, cancelled: one line with the reason, never the secret."""
    outcome = solver(service).solve(problem, 5.0, 1)
    assert (outcome.status, outcome.selected) == ("failed", None)
    assert said in (outcome.reason or "")
    assert SECRET not in (outcome.reason or "")
    assert SECRET not in repr(IskaySolver(AccountAccess(SECRET), "ibm_boston"))


def changed(**info: Any) -> Callable[[dict[str, Any]], Any]:
    """The documented answer with another ``solution_info``."""
    return lambda answer: answer | {"solution_info": answer["solution_info"] | info}


@pytest.mark.parametrize(
    "garbage",
    [
        lambda _: None,
        lambda _: "DONE",
        lambda _: {},
        lambda _: {"solution": {}, "solution_info": {"bitstring": "", "mapping": {}}},
        lambda answer: answer | {"solution": {"0": 1, "77": 0}},
        lambda answer: answer | {"solution": dict.fromkeys(answer["solution"], -1)},
        lambda answer: answer | {"solution": dict.fromkeys(answer["solution"], "one")},
        lambda answer: {"solution": answer["solution"]},
        changed(bitstring="0101"),
        changed(bitstring="2" * 6),
        changed(bitstring=None),
        changed(mapping={0: 0}),
        changed(mapping=None),
        lambda answer: changed(
            bitstring="".join("10"[int(b)] for b in answer["solution_info"]["bitstring"])
        )(answer),
    ],
)
def test_garbage_is_no_answer(
    problem: RouteProblem, garbage: Callable[[dict[str, Any]], Any]
) -> None:
    """What is not one 0 or 1 for each variable, or contradicts itself, is refused in words."""
    outcome = solver(StandIn(result_of=garbage)).solve(problem, 5.0, 1)
    assert (outcome.status, outcome.selected) == ("failed", None)
    assert "job-7" in (outcome.reason or "")


def test_too_many_variables_are_refused_before_anything_is_paid() -> None:
    """Beyond 156 variables no job is started."""
    options = tuple(RouteOption("v", (), 1.0) for _ in range(157))
    service = StandIn()
    outcome = solver(service).solve(RouteProblem(("v",), (), options), 5.0, 1)
    assert "156" in (outcome.reason or "")
    assert service.asked == []
