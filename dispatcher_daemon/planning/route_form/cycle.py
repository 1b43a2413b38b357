"""One cycle in route form: base routes, blocks, sweeps."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace

from dispatcher_daemon.planning.improvement.sweeps import Choice
from dispatcher_daemon.planning.plans import (
    Candidate,
    CandidateRefusal,
    Cycle,
    FormResult,
    Gains,
    solver_report,
)
from dispatcher_daemon.planning.route_form.fleet_plan import FleetPlan, plan_fleet
from dispatcher_daemon.solvers import Outcome
from dispatcher_daemon.solvers.workers import Solve
from slipstream.messages import SolverReport

BASE = "pyvrp"
"""Name of the solver of base routes, in reports."""
GREEDY = "greedy"


def route_cycle(
    cycle: Cycle, solve: Solve, executor: Executor, clock: Callable[[], float] = time.monotonic
) -> FormResult:
    """Plan the fleet and verify the plans."""
    checked: list[Candidate | CandidateRefusal] = []

    def check(whole: Cycle, base: Choice, unserved: Mapping[str, str]) -> None:
        found = whole.candidate(
            BASE, base.routes, base.cost_kwh, platooning=False, unserved=unserved
        )
        checked.append(found)

    plan = plan_fleet(cycle, executor, solve, clock, check)
    cycle = plan.cycle
    best = _candidate(cycle, _made_by(plan), plan.choice, plan, plan.gains_kwh)
    (baseline,) = checked
    if isinstance(baseline, Candidate):
        baseline = replace(baseline, gains_kwh=plan.base_gains_kwh)
    fallback = baseline
    # Mostly the plan is better, and to verify a large fleet's plans takes seconds.
    if not isinstance(best, Candidate) or plan.base.objective_kwh < best.objective_kwh:
        fallback = _candidate(cycle, BASE, plan.base, plan, plan.base_gains_kwh)
    vehicles = cycle.problem.fleet.vehicles
    return FormResult(
        candidates=(best,) if isinstance(best, Candidate) else (),
        reports=_reports(plan, best),
        baseline_solver=BASE,
        baseline=baseline,
        fallback=fallback,
        variables=max((sweep.largest for sweep in plan.sweeps), default=0),
        unserved=plan.unserved,
        stops={v.id: i.stops for v, i in zip(vehicles, plan.choice.itineraries, strict=True)},
        declined=plan.declined,
    )


def _candidate(
    cycle: Cycle, name: str, choice: Choice, plan: FleetPlan, gains_kwh: Gains
) -> Candidate | CandidateRefusal:
    objective = choice.objective_kwh
    return cycle.candidate(
        name, choice.routes, objective, unserved=plan.unserved, gains_kwh=gains_kwh
    )


def _made_by(plan: FleetPlan) -> str:
    """The solver whose answers were taken most often; what the sweeps began with, if none was."""
    wins: dict[str, int] = {}
    for sweep in plan.sweeps:
        for name, number in sweep.accepted.items():
            wins[name] = wins.get(name, 0) + number
    for trial in plan.trials:
        if trial.accepted:
            wins[trial.outcome.solver] = wins.get(trial.outcome.solver, 0) + 1
    if wins:
        return max(wins, key=lambda name: wins[name])
    return GREEDY if plan.greedy.objective_kwh < plan.base.objective_kwh else BASE


def _reports(plan: FleetPlan, best: Candidate | CandidateRefusal) -> tuple[SolverReport, ...]:
    """One report a solver: over all blocks of all sweeps, or of the one that it was asked for, with
    the objective that the whole plan had with its answer.
    """
    outcomes: dict[str, list[Outcome]] = {}
    for sweep in plan.sweeps:
        for outcome in sweep.outcomes:
            outcomes.setdefault(outcome.solver, []).append(outcome)
    objective = best.objective_kwh if isinstance(best, Candidate) else None
    reports = [solver_report(of_one, objective, blocks=True) for of_one in outcomes.values()]
    trials = [
        solver_report([one.outcome], one.objective_kwh, optimum_kwh=one.optimum_kwh, blocks=True)
        for one in plan.trials
    ]
    return (*reports, *trials)
