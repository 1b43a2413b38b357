"""One cycle in the paper's arc form: every solver gets the whole problem."""

from __future__ import annotations

from dispatcher_daemon.forms import build_model
from dispatcher_daemon.planning.arc_form.form import ArcForm
from dispatcher_daemon.planning.plans import Candidate, CandidateRefusal, FormResult, solver_report
from dispatcher_daemon.solvers import Outcome
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
    results = [
        None if outcome.selected is None else form.candidate(outcome.solver, outcome.selected)
        for outcome in outcomes
    ]
    proven_kwh = [
        problem.objective_kwh(outcome.selected)
        for outcome in outcomes
        if outcome.status == "optimal" and outcome.selected is not None
    ]
    optimum_kwh = min(proven_kwh, default=None)
    return FormResult(
        candidates=tuple(result for result in results if isinstance(result, Candidate)),
        reports=tuple(
            _report(outcome, result, optimum_kwh)
            for outcome, result in zip(outcomes, results, strict=True)
        ),
        baseline_solver=name,
        baseline=baseline,
        fallback=fallback,
        variables=len(build_model(problem).variables),
        unserved=form.unserved,
    )


def _report(
    outcome: Outcome, result: Candidate | CandidateRefusal | None, optimum_kwh: float | None
) -> SolverReport:
    if isinstance(result, Candidate):
        return solver_report([outcome], result.objective_kwh, optimum_kwh=optimum_kwh)
    fault = outcome.reason if result is None else f"plan refused: {result.reason}"
    return solver_report([outcome], None, fault=fault, optimum_kwh=optimum_kwh)
