"""One dispatch cycle as a function: traffic, fleet and time in; verified plans and a report out."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from dispatcher_daemon.appraisal import RouteEnergy, route_energy, summarise
from dispatcher_daemon.decode import decode
from dispatcher_daemon.fleet import DEPOT
from dispatcher_daemon.formulations.arc import build_arc_model
from dispatcher_daemon.insertion import cheapest_insertion
from dispatcher_daemon.plans import vehicle_plans
from dispatcher_daemon.platoons import Passage, Place, form_platoons
from dispatcher_daemon.problem import ArcProblem, CandidateArc, RoutingProblem
from dispatcher_daemon.rewards import JudgedPair, judge_pairs, rewards
from dispatcher_daemon.routes import (
    Leg,
    Route,
    RoutedArc,
    candidate_arcs,
    least_energy_legs,
    timetable,
)
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.base import Outcome
from dispatcher_daemon.solvers.pool import Job, Solve
from dispatcher_daemon.solvers.registry import BASELINE_SOLVER
from dispatcher_daemon.traffic import TrafficSnapshot
from dispatcher_daemon.verify import verify_plans
from slipstream.messages import CycleReport, SolverReport, VehiclePlan


@dataclass(frozen=True)
class CycleResult:
    """What one cycle gives.

    Attributes:
        report: for the dashboard and the database.
        plans: verified plans, one a vehicle; none if the cycle failed.
        arcs: the candidate arcs.
        judged: every pair of arcs that share a watched segment, and why it platoons or not.
    """

    report: CycleReport
    plans: tuple[VehiclePlan, ...]
    arcs: tuple[RoutedArc, ...]
    judged: tuple[JudgedPair, ...]


@dataclass(frozen=True)
class _Candidate:
    """A verified plan set."""

    solver: str
    objective_kwh: float
    plans: tuple[VehiclePlan, ...]
    energies: tuple[RouteEnergy, ...]


@dataclass(frozen=True)
class _Cycle:
    """What is fixed within one cycle."""

    problem: RoutingProblem
    snapshot: TrafficSnapshot
    settings: DispatcherSettings
    number: int
    now_ns: int
    legs: Mapping[tuple[str, str], Leg]

    def routes(self, stops: Mapping[str, Sequence[str]]) -> list[Route]:
        """Exact timetables; the first vehicles leave when the solvers' time is over."""
        return [
            timetable(self.problem, self.legs, v, stops[v.id], self.settings.deadline_s)
            for v in self.problem.fleet.vehicles
        ]

    def candidate(
        self, solver: str, arcs: ArcProblem, selected: frozenset[int], *, platooning: bool = True
    ) -> _Candidate | str:
        """The verified plan set of a selection of arcs, or what is wrong with it."""
        if not all(0 <= index < len(arcs.arcs) for index in selected):
            return "not a selection of arcs"
        decoded = decode(arcs, selected)
        if decoded.routes is None:
            return decoded.violations[0]
        routes = self.routes(decoded.routes)
        window = self.settings.sync_window_s
        places: dict[Passage, Place] = {}
        if platooning:
            places = form_platoons(routes, self.snapshot, window, self.number)
        energies = tuple(route_energy(self.problem, route, places) for route in routes)
        plans = vehicle_plans(
            self.problem,
            self.snapshot,
            routes,
            places,
            energies,
            cycle=self.number,
            issued_ns=self.now_ns,
            valid_s=2 * self.settings.interval_s,
            gap_m=self.settings.gap_m,
        )
        open_segments = {name for name, t in self.snapshot.segments.items() if t.open}
        faults = verify_plans(
            plans, self.problem.network, self.problem.fleet, open_segments, window
        )
        if faults:
            return faults[0]
        return _Candidate(solver, arcs.objective_kwh(selected), plans, energies)


def run_cycle(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: DispatcherSettings,
    solve: Solve,
    now_ns: int,
    cycle: int,
    seed: int,
    clock: Callable[[], float] = time.monotonic,
) -> CycleResult:
    """Run one dispatch cycle.

    Same input, same seed and a `solve` that keeps to them give the same result, wall times aside.

    Args:
        problem: roads and fleet.
        snapshot: traffic at ``now_ns``.
        solve: runs solvers by name, within the deadline, without raising.
        now_ns: UTC at the start of the cycle.
        cycle: its number.
        seed: for everything random in the solvers.
        clock: seconds, for the report's wall time only.

    Returns:
        The best verified plans of the solvers that answered; the baseline's if none did; a report
        of status "failed" without plans if there is no valid plan at all.
    """
    began = clock()
    legs = least_energy_legs(problem, snapshot)
    arcs = candidate_arcs(problem, legs, settings.deadline_s)
    judged = tuple(judge_pairs(problem, arcs, snapshot, settings.sync_window_s))
    model = arc_problem(problem, arcs, judged)
    jobs = [
        Job(BASELINE_SOLVER, model.without_platooning(), seed),
        *(Job(name, model, seed) for name in settings.solvers),
    ]
    baseline_outcome, *outcomes = solve(jobs, settings.deadline_s)

    this = _Cycle(problem, snapshot, settings, cycle, now_ns, legs)
    baseline_name, baseline_arcs = _baseline(model, baseline_outcome)
    alone: _Candidate | str = "no plan found"
    fallback: _Candidate | str = "no plan found"
    if baseline_arcs is not None:
        alone = this.candidate(baseline_name, model, baseline_arcs, platooning=False)
        fallback = this.candidate(baseline_name, model, baseline_arcs)

    found: list[_Candidate] = []
    reports: list[SolverReport] = []
    optimum = _proven_optimum(model, outcomes)
    for outcome in outcomes:
        fault = outcome.reason
        objective = None
        if outcome.selected is not None:
            candidate = this.candidate(outcome.solver, model, outcome.selected)
            if isinstance(candidate, _Candidate):
                found.append(candidate)
                objective, fault = candidate.objective_kwh, None
            else:
                fault = f"plan refused: {candidate}"
        reports.append(_solver_report(outcome, objective, fault, optimum))

    status, reason = "ok", None
    chosen = min(found, key=lambda c: c.objective_kwh, default=None)
    if chosen is None:
        said = "; ".join(f"{r.solver}: {r.reason or r.status}" for r in reports)
        if isinstance(fallback, _Candidate):
            chosen, status, reason = fallback, "baseline", f"no solver gave a valid plan ({said})"
        else:
            status, reason = "failed", f"no valid plan ({said}; baseline: {fallback})"
    energy = None
    if chosen is not None and isinstance(alone, _Candidate):
        name = f"{baseline_name}, without platooning"
        energy = summarise(name, alone.energies, chosen.energies)
    report = CycleReport.model_validate(
        {
            "cycle": cycle,
            "started_ns": now_ns,
            "wall_s": max(0.0, clock() - began),
            "status": status,
            "reason": reason,
            "solver": None if chosen is None else chosen.solver,
            "objective_kwh": None if chosen is None else chosen.objective_kwh,
            "variables": len(build_arc_model(model).variables),
            "solvers": tuple(reports),
            "gates": snapshot.gates(),
            "energy": energy,
            "plans": 0 if chosen is None else len(chosen.plans),
        }
    )
    return CycleResult(report, () if chosen is None else chosen.plans, arcs, judged)


def arc_problem(
    problem: RoutingProblem, arcs: Sequence[RoutedArc], judged: Sequence[JudgedPair]
) -> ArcProblem:
    """The arc form of one cycle."""
    depots = problem.fleet.depot_by_id

    def place(name: str) -> str:
        return DEPOT if name in depots else name

    return ArcProblem(
        depot=DEPOT,
        customers=tuple(stop.id for stop in problem.fleet.stops),
        vehicles=tuple(vehicle.id for vehicle in problem.fleet.vehicles),
        arcs=tuple(
            CandidateArc(a.vehicle, place(a.leg.start), place(a.leg.end), a.leg.cost_kwh)
            for a in arcs
        ),
        rewards=rewards(judged),
    )


def arc_problem_of(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    sync_window_s: float,
    reference_s: float = 0.0,
) -> ArcProblem:
    """The arc form of a routing problem under given traffic.

    Args:
        sync_window_s: Δt_sync.
        reference_s: when a vehicle that is ready at once leaves.
    """
    arcs = candidate_arcs(problem, least_energy_legs(problem, snapshot), reference_s)
    return arc_problem(problem, arcs, tuple(judge_pairs(problem, arcs, snapshot, sync_window_s)))


def _baseline(model: ArcProblem, outcome: Outcome) -> tuple[str, frozenset[int] | None]:
    """Name and arcs of the plan without platooning; the insertion plan if the solver is out."""
    if outcome.selected is not None:
        return outcome.solver, outcome.selected
    return "insertion", cheapest_insertion(model)


def _proven_optimum(model: ArcProblem, outcomes: Sequence[Outcome]) -> float | None:
    values = [
        model.objective_kwh(o.selected)
        for o in outcomes
        if o.status == "optimal" and o.selected is not None
    ]
    return min(values, default=None)


def _solver_report(
    outcome: Outcome, objective_kwh: float | None, fault: str | None, optimum_kwh: float | None
) -> SolverReport:
    refused = outcome.selected is not None and objective_kwh is None
    samples = outcome.samples
    optimal = None
    if samples is not None and optimum_kwh is not None:
        optimal = samples.share(samples.raw, optimum_kwh)
    return SolverReport(
        solver=outcome.solver,
        status="failed" if refused else outcome.status,
        objective_kwh=objective_kwh,
        repaired=outcome.repaired,
        p_feasible_raw=None if samples is None else samples.share(samples.raw),
        p_optimal_raw=optimal,
        p_feasible_repaired=None if samples is None else samples.share(samples.repaired),
        qubits=None if samples is None else samples.qubits,
        shots=None if samples is None else samples.shots,
        wall_s=outcome.wall_s,
        reason=fault,
    )
