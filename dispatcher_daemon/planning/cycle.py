"""One cycle in route form: base routes, blocks, sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor

from dispatcher_daemon.planning.fleet_plan import CityPlan, plan_city
from dispatcher_daemon.planning.sweeps import Choice
from dispatcher_daemon.plans.candidates import Candidate, Cycle, Found
from dispatcher_daemon.roads.routes import Route
from dispatcher_daemon.settings import CitySettings, DispatcherSettings
from dispatcher_daemon.solvers.pool import Solve
from dispatcher_daemon.solvers.protocol import Outcome, Status
from slipstream.messages import SolverReport

BASE = "pyvrp"
"""Name of what makes the base routes, in reports."""
GREEDY = "greedy"


def city_settings(settings: DispatcherSettings, vehicles: int) -> CitySettings:
    """A fleet of one block asks all of the dispatcher's solvers; a larger one those for blocks."""
    city = settings.city
    if vehicles * city.options <= city.block_variables:
        return city.model_copy(update={"solvers": settings.solvers})
    return city


def route_cycle(
    cycle: Cycle,
    solve: Solve,
    executor: Executor,
    start: Mapping[str, Sequence[str]] | None,
) -> Found:
    """Plan the fleet and verify what comes out.

    Args:
        executor: for the search of base routes.
        start: routes to start from.
    """
    settings = cycle.settings
    city = city_settings(settings, len(cycle.problem.fleet.vehicles))
    plan = plan_city(
        cycle.problem,
        cycle.snapshot,
        city,
        executor,
        solve,
        sync_window_s=settings.sync_window_s,
        seed=cycle.seed,
        deadline_s=settings.deadline_s,
        reference_s=cycle.reference_s,
        on_road=cycle.on_road,
        start=start,
    )
    made_by = _made_by(plan)
    best = _candidate(cycle, made_by, plan.choice, plan)
    candidates = (best,) if isinstance(best, Candidate) else ()
    vehicles = cycle.problem.fleet.vehicles
    return Found(
        candidates,
        _reports(plan, best),
        BASE,
        _candidate(cycle, BASE, plan.base, plan, platooning=False),
        _candidate(cycle, BASE, plan.base, plan),
        max((sweep.largest for sweep in plan.sweeps), default=0),
        plan.unserved,
        {v.id: i.stops for v, i in zip(vehicles, plan.choice.itineraries, strict=True)},
    )


def _candidate(
    cycle: Cycle, name: str, choice: Choice, plan: CityPlan, *, platooning: bool = True
) -> Candidate | str:
    routes: list[Route] = [i.route for i in choice.itineraries if i.route is not None]
    objective = choice.objective_kwh if platooning else choice.cost_kwh
    return cycle.candidate(name, routes, objective, platooning=platooning, unserved=plan.unserved)


def _made_by(plan: CityPlan) -> str:
    """The solver whose answers were taken most often; what the sweeps began with, if none was."""
    wins: dict[str, int] = {}
    for sweep in plan.sweeps:
        for name, number in sweep.taken.items():
            wins[name] = wins.get(name, 0) + number
    if wins:
        return max(wins, key=lambda name: wins[name])
    return GREEDY if plan.greedy.objective_kwh < plan.base.objective_kwh else BASE


def _reports(plan: CityPlan, best: Candidate | str) -> tuple[SolverReport, ...]:
    """One report a solver over all blocks of all sweeps."""
    outcomes: dict[str, list[Outcome]] = {}
    for sweep in plan.sweeps:
        for outcome in sweep.outcomes:
            outcomes.setdefault(outcome.solver, []).append(outcome)
    return tuple(_report(name, of_one, best) for name, of_one in outcomes.items())


def _report(name: str, outcomes: Sequence[Outcome], best: Candidate | str) -> SolverReport:
    answered = [o for o in outcomes if o.selected is not None]
    samples = [o.samples for o in outcomes if o.samples is not None]
    ran = [o.execution for o in outcomes if o.execution is not None]
    # The best that any block had: a device's answer for one is not hidden by the others.
    best_ran = max(ran, key=lambda e: (e.fallback is None, e.kind == "hardware"), default=None)
    elsewhere = [e.fallback for e in ran if e.fallback is not None]
    # Proven blocks do not prove the whole.
    status: Status = "feasible" if answered else outcomes[-1].status
    silent = [o.reason for o in outcomes if o.selected is None]
    return SolverReport(
        solver=name,
        status=status,
        objective_kwh=best.objective_kwh if answered and isinstance(best, Candidate) else None,
        repaired=any(o.repaired for o in answered),
        p_feasible_raw=_mean([s.share(s.raw) for s in samples]),
        p_optimal_raw=None,
        p_feasible_repaired=_mean([s.share(s.repaired) for s in samples]),
        qubits=max((s.qubits for s in samples if s.qubits is not None), default=None),
        shots=sum(s.shots for s in samples) if samples else None,
        wall_s=sum(o.wall_s for o in outcomes),
        reason=f"{len(silent)} of {len(outcomes)} blocks without an answer: {silent[-1]}"
        if silent
        else None,
        backend=None if best_ran is None else best_ran.backend,
        backend_kind=None if best_ran is None else best_ran.kind,
        fallback=f"{len(elsewhere)} of {len(outcomes)} blocks: {elsewhere[-1]}"
        if elsewhere
        else None,
        two_qubit_depth=max(
            (e.two_qubit_depth for e in ran if e.two_qubit_depth is not None), default=None
        ),
    )


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
