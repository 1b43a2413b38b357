"""One cycle in the paper's arc form: every solver gets the whole problem."""

from __future__ import annotations

from collections.abc import Sequence

from dispatcher_daemon.forms import ArcProblem, build_model
from dispatcher_daemon.planning.arc_form.form import ArcForm
from dispatcher_daemon.planning.plans import (
    Attempt,
    Candidate,
    CandidateRefusal,
    FormResult,
    attempt,
    solver_report,
)
from dispatcher_daemon.solvers.workers import PoolJob, Solve, solving_s
from slipstream.messages import SolverReport


def arc_cycle(form: ArcForm, solve: Solve) -> FormResult:
    """Run all solvers, and the baseline's for the plan without platooning."""
    problem, settings, seed = form.problem, form.cycle.settings, form.cycle.seed
    jobs = [form.baseline_job, *(PoolJob(name, problem, seed) for name in settings.solvers)]
    baseline_outcome, *outcomes = solve(jobs, solving_s(settings.deadline_s))
    name, selected = form.baseline_answer(baseline_outcome)
    baseline: Candidate | CandidateRefusal = CandidateRefusal(("no plan found",))
    fallback = baseline
    if selected is not None:
        baseline = form.candidate(name, selected, platooning=False)
        fallback = form.candidate(name, selected)
    attempts = [attempt(form, outcome) for outcome in outcomes]
    optimum = _proven_optimum(problem, attempts)
    return FormResult(
        candidates=tuple(a.candidate for a in attempts if a.candidate is not None),
        reports=tuple(_report(a, optimum) for a in attempts),
        baseline_solver=name,
        baseline=baseline,
        fallback=fallback,
        variables=len(build_model(problem).variables),
        unserved=form.unserved,
    )


def _report(attempt: Attempt, optimum_kwh: float | None) -> SolverReport:
    outcome, result = attempt.outcome, attempt.result
    if isinstance(result, Candidate):
        return solver_report([outcome], result.objective_kwh, optimum_kwh=optimum_kwh)
    refused = outcome.selected is not None
    fault = f"plan refused: {result.reason}" if refused else outcome.reason
    return solver_report([outcome], None, fault=fault, optimum_kwh=optimum_kwh)


def _proven_optimum(problem: ArcProblem, attempts: Sequence[Attempt]) -> float | None:
    values = [
        problem.objective_kwh(a.outcome.selected)
        for a in attempts
        if a.outcome.status == "optimal" and a.outcome.selected is not None
    ]
    return min(values, default=None)
