"""One cycle in the paper's arc form: every solver gets the whole problem."""

from __future__ import annotations

from collections.abc import Sequence

from dispatcher_daemon.arc_form.arcs import arc_parts_of
from dispatcher_daemon.formulations.decode import decode
from dispatcher_daemon.formulations.model import build_model
from dispatcher_daemon.planning.itineraries import Planner
from dispatcher_daemon.planning.sweeps import Choice, simple_choices
from dispatcher_daemon.plans.candidates import Candidate, Cycle, Found
from dispatcher_daemon.problem import ArcProblem
from dispatcher_daemon.roads.routes import Route, timetable
from dispatcher_daemon.solvers.insertion import cheapest_insertion
from dispatcher_daemon.solvers.pool import Job, Solve, solving_s
from dispatcher_daemon.solvers.protocol import Outcome
from dispatcher_daemon.solvers.registry import BASELINE_SOLVER
from slipstream.messages import SolverReport


class ArcCycle:
    """The arc form of one cycle.

    Attributes:
        parts: what it is made of.
    """

    def __init__(self, cycle: Cycle) -> None:
        """Build it."""
        self._cycle = cycle
        settings = cycle.settings
        self.parts = arc_parts_of(
            cycle.problem, cycle.snapshot, settings.sync_window_s, cycle.reference_s
        )

    def run(self, solve: Solve) -> Found:
        """Ask all solvers, and one for the plan without platooning."""
        model, settings, seed = self.parts.problem, self._cycle.settings, self._cycle.seed
        jobs = [
            Job(BASELINE_SOLVER, model.without_platooning(), seed),
            *(Job(name, model, seed) for name in settings.solvers),
        ]
        baseline_outcome, *outcomes = solve(jobs, solving_s(settings.deadline_s))
        baseline, baseline_arcs = _baseline(model, baseline_outcome)
        alone: Candidate | str = "no plan found"
        fallback: Candidate | str = "no plan found"
        if baseline_arcs is not None:
            alone = self._candidate(baseline, baseline_arcs, platooning=False)
            fallback = self._candidate(baseline, baseline_arcs)
        found: list[Candidate] = []
        reports: list[SolverReport] = []
        optimum = _proven_optimum(model, outcomes)
        for outcome in outcomes:
            fault, objective = outcome.reason, None
            if outcome.selected is not None:
                candidate = self._candidate(outcome.solver, outcome.selected)
                if isinstance(candidate, Candidate):
                    found.append(candidate)
                    objective, fault = candidate.objective_kwh, None
                else:
                    fault = f"plan refused: {candidate}"
            reports.append(solver_report(outcome, objective, fault, optimum))
        variables = len(build_model(model).variables)
        return Found(tuple(found), tuple(reports), baseline, alone, fallback, variables)

    def _candidate(
        self, solver: str, selected: frozenset[int], *, platooning: bool = True
    ) -> Candidate | str:
        model, legs, cycle = self.parts.problem, self.parts.legs, self._cycle
        if not all(0 <= index < len(model.arcs) for index in selected):
            return "not a selection of arcs"
        decoded = decode(model, selected)
        if decoded.routes is None:
            return decoded.violations[0]
        # The first vehicles leave when the solvers' time is over.
        routes = [
            timetable(cycle.problem, legs, v, decoded.routes[v.id], cycle.reference_s)
            for v in cycle.problem.fleet.vehicles
        ]
        if not platooning:
            cost = model.without_platooning().objective_kwh(selected)
            return cycle.candidate(solver, routes, cost, platooning=False)
        choice = self._scheduled(routes)
        if choice is None:
            return cycle.candidate(solver, routes, model.objective_kwh(selected))
        driven = [i.route for i in choice.itineraries if i.route is not None]
        return cycle.candidate(solver, driven, choice.objective_kwh)

    def _scheduled(self, routes: Sequence[Route]) -> Choice | None:
        """Departures chosen within the vehicles' windows so that platoons meet, and the exact
        objective: rewards of the arc form may rest on entry times that are too early.
        """
        cycle = self._cycle
        settings = cycle.settings
        planner = Planner(
            cycle.problem, cycle.snapshot, [], settings.sync_window_s, cycle.reference_s
        )
        present = [
            planner.itinerary(n, tuple(v.place for v in route.visits[1:-1]), route.legs)
            for n, route in enumerate(routes)
        ]
        itineraries = [itinerary for itinerary in present if itinerary is not None]
        if len(itineraries) < len(routes):
            return None
        return min(simple_choices(planner, itineraries), key=lambda c: c.objective_kwh)


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


def solver_report(
    outcome: Outcome, objective_kwh: float | None, fault: str | None, optimum_kwh: float | None
) -> SolverReport:
    """What the report of a cycle says of one outcome.

    Args:
        objective_kwh: of the plan that it led to; None if there is none.
        fault: why there is none.
        optimum_kwh: proven by any of the solvers.
    """
    refused = outcome.selected is not None and objective_kwh is None
    samples, ran = outcome.samples, outcome.execution
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
        backend=None if ran is None else ran.backend,
        backend_kind=None if ran is None else ran.kind,
        fallback=None if ran is None else ran.fallback,
        two_qubit_depth=None if ran is None else ran.two_qubit_depth,
    )
