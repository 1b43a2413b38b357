from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

from dispatcher_daemon.forms.problem import Problem, RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import CycleResult, form_of, run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.plans.verify import verify_plans
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.protocol import Outcome, Solver, Status
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.errors import InputError
from slipstream_lab.research.cities.generator import CityShape, generate_city

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
SETTINGS = DispatcherSettings(
    form="route",
    solvers=("exact",),
    city=CitySettings(
        search=SearchSettings(rounds=2, iterations_per_stop=5, workers=1),
        second_rounds=1,
        max_sweeps=4,
        patience=2,
    ),
)


class Silent:
    """Never has an answer."""

    name = "exact"

    def warm_up(self) -> None:
        """Nothing to do."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """None."""
        return Outcome(self.name, "timeout", None, 0.0, reason="too slow")


def cycle(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    settings: DispatcherSettings = SETTINGS,
    *,
    solvers: Sequence[Solver] = (ExactSolver(),),
    start: Mapping[str, Sequence[str]] | None = None,
) -> CycleResult:
    """Cycle 3, in this process."""
    solve = solve_in_process(solvers)
    this = Cycle(problem, snapshot, settings, 3, snapshot.now_ns, 11, start=start)
    return run_cycle(this, solve)


def faults(
    problem: RoutingProblem, snapshot: TrafficSnapshot, result: CycleResult
) -> tuple[str, ...]:
    """What the verifier says of plans that left."""
    return verify_plans(
        result.plans,
        problem.network,
        problem.fleet,
        {name for name, t in snapshot.segments.items() if t.open},
        SETTINGS.sync_window_s,
        unserved={u.stop for u in result.report.unserved},
        reference_s=SETTINGS.deadline_s,
    )


@pytest.mark.slow
def test_base_routes_are_verified_once_where_the_plan_is_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without platooning, for the baseline; then the plan, and no third time."""
    city = generate_city(1, vehicles=8, stops=24, segments=100)
    verified, candidate = list[bool](), Cycle.candidate

    def counted(self: Cycle, *args: Any, platooning: bool = True, **named: Any) -> Any:
        verified.append(platooning)
        return candidate(self, *args, platooning=platooning, **named)

    monkeypatch.setattr(Cycle, "candidate", counted)
    result = cycle(city.problem, city.snapshot)
    assert result.report.status == "ok"
    assert verified == [False, True]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_city_s_plans_are_sound_and_its_energy_adds_up(seed: int) -> None:
    """Plans pass the verifier from outside; the saving's parts are its total, the energy that of
    the plans, and what drafting saves is positive.
    """
    city = generate_city(
        seed, vehicles=12, stops=36, segments=160, shape=CityShape(depots=1, open_share=0.9)
    )
    result = cycle(city.problem, city.snapshot)
    report, energy = result.report, result.report.energy
    assert (report.status, report.reason) == ("ok", None)
    assert report.solver in {"exact", "greedy"}
    assert faults(city.problem, city.snapshot, result) == ()
    assert report.unserved == ()
    assert 0 < report.variables <= SETTINGS.city.block_variables
    assert energy is not None
    assert energy.baseline == "pyvrp, without platooning"
    assert energy.baseline_kwh - energy.cooperative_kwh == pytest.approx(
        energy.saved_distance_kwh + energy.saved_drag_kwh + energy.saved_acceleration_kwh,
        abs=1e-9,
    )
    assert energy.saved_drag_kwh > 0
    assert energy.platooned_distance_m > 0
    assert energy.cooperative_kwh == pytest.approx(sum(p.energy_kwh for p in result.plans))
    assert {v: tuple(s) for v, s in result.stops.items() if s} == {
        p.vehicle: tuple(s.stop for s in p.stops[1:-1]) for p in result.plans
    }


def test_what_is_not_served_is_reported_and_who_is_idle_has_no_plan(town: Town) -> None:
    """A stop out of reach and one too heavy are in the report with their reasons, the van that is
    not needed has no plan, and the others' plans leave.
    """
    stops = ["33", {"id": "far", "node": "q"}, {"id": "heavy", "node": "22", "demand": 9}]
    problem, snapshot = town(stops, [{"capacity": 5}] * 3)
    result = cycle(problem, snapshot)
    assert result.report.status == "ok"
    reasons = {u.stop: u.reason for u in result.report.unserved}
    assert "cannot be reached" in reasons["far"]
    assert "above every capacity" in reasons["heavy"]
    assert len(reasons) == 2
    assert len(result.plans) == result.report.plans == 1
    assert faults(problem, snapshot, result) == ()


def test_a_fleet_that_can_serve_nothing_reports_it(town: Town) -> None:
    """All stops out of reach: no plans, every stop named, and no crash."""
    problem, snapshot = town(["q", "p"], [{}])
    result = cycle(problem, snapshot)
    assert result.plans == ()
    assert {u.stop for u in result.report.unserved} == {"s0", "s1"}


@pytest.mark.long
def test_without_any_answer_the_routes_still_leave() -> None:
    """Solvers that never answer cost improvement only; that they were silent is reported."""
    city = generate_city(
        1, vehicles=12, stops=36, segments=160, shape=CityShape(depots=1, open_share=0.9)
    )
    result = cycle(city.problem, city.snapshot, solvers=[Silent()])
    assert result.report.status == "ok"
    assert result.report.solver in {"pyvrp", "greedy"}
    assert faults(city.problem, city.snapshot, result) == ()
    (silent,) = result.report.solvers
    assert (silent.solver, silent.status, silent.objective_kwh) == ("exact", "timeout", None)
    assert "blocks without an answer: too slow" in (silent.reason or "")
    answered = cycle(city.problem, city.snapshot)
    assert answered.report.objective_kwh is not None
    assert result.report.objective_kwh is not None
    assert answered.report.objective_kwh <= result.report.objective_kwh + 1e-9


class Stranger:
    """A solver of somebody else's, asked for one block of a cycle."""

    name = "lc-qaoa"

    def __init__(self, answer: Callable[[Problem], frozenset[int] | None]) -> None:
        self.answer, self.asked = answer, list[Problem]()

    def warm_up(self) -> None:
        """Nothing to do."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """What it is told to answer."""
        self.asked.append(problem)
        selected = self.answer(problem)
        status: Status = "timeout" if selected is None else "feasible"
        reason = "never done" if selected is None else None
        return Outcome(self.name, status, selected, 0.1, reason=reason)


def broken(problem: Problem) -> frozenset[int] | None:
    """It raises."""
    raise RuntimeError("no such gate")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "status", "reason"),
    [
        (lambda p: frozenset(of[-1] for of in p.options_of.values()), "feasible", None),
        (lambda p: frozenset([0, 1, 10**6]), "feasible", None),
        (lambda p: None, "timeout", "1 of 1 blocks without an answer: never done"),
        (broken, "failed", "1 of 1 blocks without an answer: RuntimeError: no such gate"),
    ],
)
def test_a_fleet_of_many_blocks_asks_the_other_solvers_for_one(
    answer: Callable[[Any], frozenset[int] | None], status: str, reason: str | None
) -> None:
    """Once a cycle, for a block that fits, beside those of all blocks. The plan is no worse for a
    bad answer, for nonsense or for none, and the report has the objective with its answer.
    """
    city = generate_city(
        1, vehicles=12, stops=36, segments=160, shape=CityShape(depots=1, open_share=0.9)
    )
    stranger = Stranger(answer)
    settings = SETTINGS.model_copy(update={"solvers": ("exact", "lc-qaoa")})
    result = cycle(city.problem, city.snapshot, settings, solvers=[ExactSolver(), stranger])
    alone = cycle(city.problem, city.snapshot)
    (problem,) = stranger.asked
    assert 2 <= problem.choices <= settings.city.block_variables
    assert problem.pair_savings
    exact, asked = result.report.solvers
    assert (asked.solver, asked.status, asked.reason) == ("lc-qaoa", status, reason)
    assert exact.solver == "exact"
    assert result.report.objective_kwh == alone.report.objective_kwh
    assert result.report.solver == alone.report.solver
    if asked.objective_kwh is not None:
        assert result.report.objective_kwh is not None
        assert asked.objective_kwh > result.report.objective_kwh + 1e-6
    else:
        assert reason is not None or answer(problem) == frozenset([0, 1, 10**6])


@pytest.mark.slow
def test_a_better_answer_for_one_block_is_accepted_and_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where those of all blocks have none, the plan is what the other solver makes of it."""
    city = generate_city(
        1, vehicles=12, stops=36, segments=160, shape=CityShape(depots=1, open_share=0.9)
    )
    # A schedule that nobody has improved yet.
    monkeypatch.setattr(
        "dispatcher_daemon.planning.route_form.fleet_plan.scheduled",
        lambda planner, base, has_time=None: base,
    )
    stranger = Stranger(lambda p: ExactSolver().solve(p, 5.0, 1).selected)
    settings = SETTINGS.model_copy(update={"solvers": ("exact", "lc-qaoa")})
    result = cycle(city.problem, city.snapshot, settings, solvers=[Silent(), stranger])
    assert result.report.solver == "lc-qaoa"
    (asked,) = [one for one in result.report.solvers if one.solver == "lc-qaoa"]
    assert asked.objective_kwh == pytest.approx(result.report.objective_kwh)
    assert faults(city.problem, city.snapshot, result) == ()


def test_the_arc_form_refuses_time_windows_by_name(town: Town) -> None:
    """Asked for arcs, a fleet with a window is bad input that names the key and the way out; left
    to itself the dispatcher takes routes.
    """
    stop: dict[str, Any] = {"id": "early", "node": "33", "latest_s": 900.0}
    problem, snapshot = town([stop], [{}])
    with pytest.raises(InputError, match="stop 'early' has a time window") as caught:
        cycle(problem, snapshot, SETTINGS.model_copy(update={"form": "arc"}))
    assert caught.value.key == "form"
    assert "take 'route'" in str(caught.value)
    automatic = SETTINGS.model_copy(update={"form": "auto"})
    assert form_of(automatic, problem.fleet) == "route"
    assert faults(problem, snapshot, cycle(problem, snapshot, automatic)) == ()
    plain, _ = town(["33"], [{}])
    assert form_of(automatic, plain.fleet) == "arc"


def test_a_cycle_starts_from_the_last_one_s_routes(town: Town) -> None:
    """Without search the next cycle serves the stops as the given routes do, not as its own."""
    problem, snapshot = town(["33", "30", "03", "22"], [{}, {}])
    still = SETTINGS.city.model_copy(
        update={"search": SearchSettings(rounds=0, workers=1), "second_rounds": 0, "max_sweeps": 0}
    )
    settings = SETTINGS.model_copy(update={"city": still})
    start = {"van-0": ("s1", "s0"), "van-1": ("s3", "s2")}
    warm = cycle(problem, snapshot, settings, start=start)
    assert set(warm.stops.values()) == set(start.values())
    assert set(cycle(problem, snapshot, settings).stops.values()) != set(start.values())
