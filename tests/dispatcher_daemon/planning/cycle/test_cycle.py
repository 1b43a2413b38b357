from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import pytest

from dispatcher_daemon.forms.problem import ArcProblem, RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.plans.verify import verify_plans
from dispatcher_daemon.settings import DispatcherSettings, LcQaoaSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome, Solver
from dispatcher_daemon.solvers.registry import configured_solvers
from dispatcher_daemon.solvers.workers.pool import PoolJob, solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Traffic = Callable[..., TrafficSnapshot]
EXACT = DispatcherSettings(solvers=("exact",))
BOTH = DispatcherSettings(lc_qaoa=LcQaoaSettings(shots=512))


@dataclass(frozen=True)
class Scripted:
    """Answers with a fixed selection, or not at all."""

    selected: frozenset[int] | None
    name: str = "lc-qaoa"

    def warm_up(self) -> None:
        """Nothing to do."""

    def solve(self, problem: ArcProblem, deadline_s: float, seed: int) -> Outcome:
        """The script's answer."""
        if self.selected is None:
            return Outcome(self.name, "timeout", None, 0.0, reason="too slow")
        return Outcome(self.name, "feasible", self.selected, 0.0)


def cycle(
    demo: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: DispatcherSettings = EXACT,
    solvers: Sequence[Solver] | None = None,
) -> CycleResult:
    """Cycle 3 with a clock that stands still."""
    solve = solve_in_process(configured_solvers(settings) if solvers is None else solvers)
    this = Cycle(demo, snapshot, settings, 3, snapshot.now_ns, 11)
    return run_cycle(this, solve, clock=lambda: 0.0)


def stops(result: CycleResult) -> dict[str, tuple[str, ...]]:
    """Stops by vehicle, without the depot."""
    return {plan.vehicle: tuple(s.stop for s in plan.stops[1:-1]) for plan in result.plans}


@pytest.mark.parametrize(
    ("y_e", "routes"),
    [
        (1, {"van-a": ("c1", "c4"), "van-b": ("c3", "c2")}),
        (0, {"van-a": ("c1", "c2"), "van-b": ("c3", "c4")}),
        (None, {"van-a": ("c1", "c2"), "van-b": ("c3", "c4")}),
    ],
)
def test_the_flag_on_the_avenue_decides_the_routes(
    demo: RoutingProblem, traffic: Traffic, y_e: int | None, routes: dict[str, tuple[str, ...]]
) -> None:
    """Seen stable, avenue_west draws both vans into a platoon; turbulent or unknown it does not."""
    result = cycle(demo, traffic(avenue_east=1, avenue_west=y_e))
    assert result.report.status == "ok"
    assert stops(result) == routes
    on_west = [s for p in result.plans for s in p.segments if s.segment == "avenue_west"]
    if y_e == 1:
        assert sorted((s.place, s.gap_m) for s in on_west) == [(0, None), (1, 2.0)]
    assert all(s.platoon is None for s in on_west) or y_e == 1


def test_a_cycle_reports_gates_variables_and_energy(demo: RoutingProblem, traffic: Traffic) -> None:
    """The report has 25 variables, a gate a watched segment, and a saving whose parts add up."""
    result = cycle(demo, traffic(avenue_east=1, avenue_west=1))
    report = result.report
    assert (report.cycle, report.variables, report.plans) == (3, 25, 2)
    assert [(g.segment, g.open) for g in report.gates] == [
        ("avenue_east", True),
        ("avenue_west", True),
    ]
    energy = report.energy
    assert energy is not None
    assert energy.baseline == "exact, without platooning"
    assert energy.baseline_kwh - energy.cooperative_kwh == pytest.approx(
        energy.saved_distance_kwh + energy.saved_drag_kwh + energy.saved_acceleration_kwh,
        abs=1e-12,
    )
    assert energy.saved_distance_kwh < 0 < energy.saved_drag_kwh
    assert energy.cooperative_kwh < energy.baseline_kwh
    assert energy.cooperative_kwh == pytest.approx(sum(p.energy_kwh for p in result.plans))
    assert energy.platooned_distance_m == pytest.approx(4 * 1995.8, abs=1.0)


@pytest.mark.slow
def test_both_solvers_are_reported_side_by_side(demo: RoutingProblem, traffic: Traffic) -> None:
    """LC-QAOA stands beside the exact answer with its raw and repaired shares."""
    patient = BOTH.model_copy(update={"deadline_s": 250.0, "interval_s": 251.0})
    result = cycle(demo, traffic(avenue_east=1, avenue_west=1), patient)
    exact, lc_qaoa = result.report.solvers
    assert (exact.solver, exact.status) == ("exact", "optimal")
    assert (lc_qaoa.solver, lc_qaoa.qubits, lc_qaoa.shots) == ("lc-qaoa", 25, 512)
    assert lc_qaoa.p_feasible_raw is not None
    assert lc_qaoa.p_optimal_raw is not None
    assert lc_qaoa.p_feasible_repaired is not None
    assert lc_qaoa.p_optimal_raw <= lc_qaoa.p_feasible_raw <= lc_qaoa.p_feasible_repaired
    assert exact.objective_kwh is not None
    assert lc_qaoa.objective_kwh is not None
    assert lc_qaoa.objective_kwh >= exact.objective_kwh - 1e-9
    assert result.report.objective_kwh == exact.objective_kwh


@pytest.mark.long
def test_same_input_same_seed_same_result(demo: RoutingProblem, traffic: Traffic) -> None:
    """A cycle run again gives the same plans and report, wall times aside."""
    snapshot = traffic(avenue_east=1, avenue_west=1)
    one, two = (cycle(demo, snapshot, BOTH) for _ in range(2))
    assert one.plans == two.plans
    for a, b in zip(one.report.solvers, two.report.solvers, strict=True):
        assert a.model_copy(update={"wall_s": 0.0}) == b.model_copy(update={"wall_s": 0.0})


class BaselineOnly:
    """Solves the baseline exactly; the cooperative jobs get a script."""

    def __init__(self, script: Scripted) -> None:
        self._script = script

    def __call__(self, jobs: Sequence[PoolJob], deadline_s: float) -> list[Outcome]:
        """The first job is the baseline's."""
        outcomes = [ExactSolver().solve(jobs[0].problem, deadline_s, 1)]
        for job in jobs[1:]:
            outcome = self._script.solve(job.problem, deadline_s, job.seed)
            outcomes.append(replace(outcome, solver=job.solver))
        return outcomes


@pytest.mark.parametrize(
    ("selected", "reason"),
    [
        (None, "exact: too slow"),
        (frozenset(range(16)), "plan refused"),
        (frozenset({99}), "plan refused: not a selection of arcs"),
        (frozenset(), "plan refused: van-a: does not leave depot"),
    ],
)
def test_baseline_leaves_if_no_solver_has_a_valid_plan(
    demo: RoutingProblem, traffic: Traffic, selected: frozenset[int] | None, reason: str
) -> None:
    """Late, invalid or absurd answers are refused with the reason; the baseline plan goes out."""
    snapshot = traffic(avenue_east=1, avenue_west=1)
    solve = BaselineOnly(Scripted(selected))
    result = run_cycle(Cycle(demo, snapshot, BOTH, 3, snapshot.now_ns, 11), solve)
    assert result.report.status == "baseline"
    assert reason in (result.report.reason or "")
    assert stops(result) == {"van-a": ("c1", "c2"), "van-b": ("c3", "c4")}
    assert all(s.status in {"timeout", "failed"} for s in result.report.solvers)
    assert all(s.objective_kwh is None for s in result.report.solvers)


def test_even_without_any_solver_a_verified_plan_leaves(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """With every solver out the insertion plan is the baseline, named as such."""
    solvers = [Scripted(None, "exact"), Scripted(None)]
    result = cycle(demo, traffic(avenue_east=1), BOTH, solvers)
    assert (result.report.status, result.report.solver) == ("baseline", "insertion")
    energy = result.report.energy
    assert energy is not None
    assert energy.baseline == "insertion, without platooning"
    faults = verify_plans(
        result.plans,
        demo.network,
        demo.fleet,
        {"avenue_east"},
        3.0,
        reference_s=EXACT.deadline_s,
    )
    assert faults == ()


def test_a_solver_that_lies_about_its_objective_gains_nothing(
    demo: RoutingProblem, traffic: Traffic
) -> None:
    """Objectives are re-evaluated: the better plan wins whatever the other says of itself."""
    snapshot = traffic(avenue_east=1, avenue_west=1)
    parallel = frozenset({0, 2, 6, 8, 11, 15})
    result = cycle(demo, snapshot, BOTH, [ExactSolver(), Scripted(parallel)])
    assert result.report.solver == "exact"
    assert stops(result) == {"van-a": ("c1", "c4"), "van-b": ("c3", "c2")}


def test_plans_are_out_before_anyone_leaves(demo: RoutingProblem, traffic: Traffic) -> None:
    """Departures lie behind the solvers' deadline, each vehicle's own readiness added."""
    snapshot = traffic(avenue_east=1)
    result = cycle(demo, snapshot)
    leaves = [(p.depart_ns - snapshot.now_ns) * 1e-9 for p in result.plans]
    assert leaves == pytest.approx([EXACT.deadline_s, EXACT.deadline_s + 2.0])
