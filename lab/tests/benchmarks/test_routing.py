"""The routing benchmark: its arithmetic, its report and its plots on made-up figures."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from dispatcher_daemon.forms.problem import Problem, RouteOption, RouteProblem
from dispatcher_daemon.planning.platooning import form_platoons
from dispatcher_daemon.planning.roads import fleet_travel
from dispatcher_daemon.planning.route_form import initial_plans
from dispatcher_daemon.settings import CitySettings, SearchSettings
from dispatcher_daemon.solvers.protocol import Outcome
from slipstream.errors import InputError
from slipstream_lab.benchmarks.command import parts_of
from slipstream_lab.benchmarks.routing import published, report
from slipstream_lab.benchmarks.routing.__main__ import main
from slipstream_lab.benchmarks.routing.bench import FULL, PARTS, SHORT, CitySize
from slipstream_lab.benchmarks.routing.figures import (
    CityRun,
    Gap,
    InstanceRow,
    SolverAnswer,
    log_slope,
    medians_by_size,
    relative,
    saved_share,
    spread,
)
from slipstream_lab.benchmarks.routing.gap_run import improved, measure_gap, undivided
from slipstream_lab.benchmarks.routing.instances import answer
from slipstream_lab.benchmarks.routing.objectives import (
    WINDOWS_S,
    ceilings_kwh,
    exact_drives,
    measured,
)
from slipstream_lab.benchmarks.routing.plots import draw
from slipstream_lab.benchmarks.routing.report import RoutingResults, checks, markdown
from slipstream_lab.benchmarks.routing.tables import percent
from slipstream_lab.benchmarks.routing.watch import tree_mb, watched
from slipstream_lab.research.cities.generator import generate_city
from slipstream_lab.research.instances.forms import instance_cycle

RUN = CityRun(
    seed=1,
    vehicles=200,
    stops=1000,
    segments=2000,
    solver_seed=1,
    budget_s=30.0,
    wall_s=20.0,
    cpu_s=35.0,
    peak_mb=900.0,
    objective_kwh=99.0,
    cost_kwh=101.0,
    saving_kwh=2.0,
    base_kwh=100.0,
    base_met_kwh=99.9,
    greedy_kwh=99.5,
    base_driven_kwh=80.0,
    saved_distance_kwh=-0.8,
    saved_drag_kwh=1.6,
    saved_acceleration_kwh=0.4,
    saved_stops_kwh=0.1,
    driving_h=50.5,
    base_driving_h=50.0,
    unserved=0,
    sweeps=3,
    blocks=12,
    timed_out=False,
    stages_s={"roads": 0.4, "base": 12.0, "greedy": 0.6, "sweeps": 7.0},
)


def instance(exact_s: float = 0.05, exact_kwh: float | None = 1.0) -> InstanceRow:
    """A named instance that two solvers worked on."""
    return InstanceRow(
        "i",
        25,
        1.0,
        {
            "exact": SolverAnswer(
                (exact_s, 9.0 * exact_s, exact_s), exact_kwh, exact_kwh is not None
            ),
            "tabu": SolverAnswer((0.02,), 1.1, False),
        },
    )


def fleets(exponent: float) -> tuple[CityRun, ...]:
    """Cycles whose time grows with that power of the fleet."""
    return tuple(
        replace(RUN, vehicles=n, wall_s=factor * (n / 100) ** exponent)
        for n in (10, 100, 500)
        for factor in (1.0, 1.1, 5.0)
    )


GOOD = RoutingResults(
    instances=(instance(), instance(0.06)),
    city=(RUN, replace(RUN, wall_s=29.0, objective_kwh=99.4)),
    best=(replace(RUN, budget_s=600.0, wall_s=590.0, objective_kwh=98.5),),
    large=(replace(RUN, vehicles=2000, budget_s=120.0, wall_s=115.0),),
    fixed=fleets(1.1),
    rivals=(
        replace(RUN, rival_kwh=99.7, rival_cpu_s=60.0),
        replace(RUN, seed=2, objective_kwh=97.0, rival_kwh=100.0, rival_cpu_s=60.0),
    ),
    gaps=(
        Gap(1, 10, 40, 3, 1.1, 1.01, 1.0, True, 2.0),
        Gap(2, 10, 40, 3, 1.1, 1.0, 0.9, False, 9.0),
    ),
)


def test_slope_of_a_power_law_is_its_exponent() -> None:
    """Whatever its factor, and from the medians of each size."""
    assert log_slope([10, 100, 1000], [0.3, 6.0, 120.0]) == pytest.approx(1.30103, abs=1e-5)
    assert medians_by_size(fleets(1.0)) == [
        (10, pytest.approx(0.11)),
        (100, pytest.approx(1.1)),
        (500, pytest.approx(5.5)),
    ]


@pytest.mark.parametrize(("sizes", "times"), [([10, 10], [1.0, 2.0]), ([10, 20], [0.0, 1.0])])
def test_no_slope_without_two_sizes_and_positive_times(
    sizes: list[float], times: list[float]
) -> None:
    """Nothing is made up."""
    with pytest.raises(ValueError, match="slope"):
        log_slope(sizes, times)


def test_shares_have_the_reference_below_them_whatever_its_sign() -> None:
    """Rewards can push an objective below zero."""
    assert relative(102.0, 100.0) == pytest.approx(0.02)
    assert relative(-98.0, -100.0) == pytest.approx(0.02)
    assert saved_share(97.0, 100.0) == pytest.approx(0.03)


def test_spread() -> None:
    """Mean, least, median and most."""
    found = spread([1.0, 2.0, 6.0])
    assert (found.mean, found.least, found.median, found.most) == (3.0, 1.0, 2.0, 6.0)


def test_a_share_that_rounds_to_nothing_has_no_sign() -> None:
    """Optima are published to 1e-9 kWh; nobody is below them."""
    assert percent(-1e-9) == "0.00 %"
    assert percent(0.12345, 1) == "12.3 %"


def test_aims_that_are_reached() -> None:
    """All of them, with the figures that they were judged by."""
    found = {check.what: check for check in checks(GOOD)}
    assert all(check.reached for check in found.values())
    shown = {what.split(",")[0].split(":")[0]: check.measured for what, check in found.items()}
    assert shown["exact answer to 2 named instances"] == "0.0550 (0.0500 to 0.0600)"
    assert shown["whole cycle"] == "29.0"
    assert shown["its objective above the best known (longest run"] == "0.91 %"
    assert shown["objective below the VRP without platooning"] == "2.00 % (1.00 % to 3.00 %)"
    assert shown["objective below route-then-schedule greedy"] == "1.51 % (0.50 % to 2.51 %)"
    assert (
        shown["blocks above the undivided optimum"] == "1.000 % (worst 1.000 %); 90.0 % of its gain"
    )
    own = "PyVRP's own search without platooning"
    assert shown[f"base routes above {own}"] == "0.30 %"
    assert shown[f"objective below {own}"] == "1.85 % (0.70 % to 3.00 %)"
    assert shown["sweeps in 120 s"] == "3"
    assert shown["its time beyond what it was given"] == "-4.2 %"
    assert [c.measured for c in found.values() if "slope" in c.what] == ["1.10"]


@pytest.mark.parametrize(
    ("results", "missed"),
    [
        (RoutingResults((instance(0.11),)), "exact answer to 1 named"),
        (RoutingResults((instance(exact_kwh=1.01),)), "of them answered"),
        (RoutingResults((instance(exact_kwh=None),)), "of them answered"),
        (RoutingResults(city=(RUN, replace(RUN, wall_s=30.1))), "whole cycle"),
        (RoutingResults(city=(replace(RUN, peak_mb=2001.0),)), "its peak memory"),
        (
            RoutingResults(city=(RUN,), best=(replace(RUN, objective_kwh=98.0),)),
            "its objective above",
        ),
        (RoutingResults(fixed=fleets(1.31)), "log-log slope"),
        (RoutingResults(rivals=(replace(RUN, base_met_kwh=98.9), *GOOD.rivals)), "cities in which"),
        (RoutingResults(rivals=(replace(RUN, greedy_kwh=98.0),)), "objective below route"),
        (RoutingResults(rivals=(replace(RUN, rival_kwh=99.4),)), "base routes above PyVRP's own"),
        (RoutingResults(large=(replace(RUN, sweeps=2),)), "sweeps in 30 s"),
        (RoutingResults(large=(replace(RUN, wall_s=33.1),)), "its time beyond"),
        (RoutingResults(large=(replace(RUN, peak_mb=2001.0),)), "its peak memory"),
    ],
)
def test_aims_that_are_missed(results: RoutingResults, missed: str) -> None:
    """Each is named for itself."""
    names = [check.what for check in checks(results) if check.reached is False]
    assert len(names) == 1
    assert names[0].startswith(missed)


def test_the_best_known_may_come_from_a_short_run() -> None:
    """A long run that found less is no reference."""
    results = RoutingResults(city=(RUN,), best=(replace(RUN, objective_kwh=99.5),))
    assert results.best_known_kwh == 99.0
    (above,) = (c for c in checks(results) if c.what.startswith("its objective"))
    assert above.measured == "0.00 %"


def test_a_gap_that_nobody_proved_is_no_gap() -> None:
    """It is neither reached nor missed."""
    (check,) = checks(RoutingResults(gaps=GOOD.gaps[1:]))
    assert (check.measured, check.reached) == ("none proven", None)


def test_the_gain_that_blocks_reach() -> None:
    """A share of what the undivided optimum gains on the start; all of it where there is none."""
    gap = GOOD.gaps[0]
    assert (gap.gained, gap.share) == (pytest.approx(0.9), pytest.approx(0.01))
    assert replace(gap, start_kwh=1.0, sweep_kwh=1.0).gained == 1.0


@pytest.mark.parametrize("seed", range(4))
def test_blocks_are_solved_with_all_others_as_they_are(seed: int) -> None:
    """Each block's answer is the best by enumeration, losses between options included."""
    rng = np.random.default_rng(seed)
    vehicles = tuple("abcd")
    options = tuple(RouteOption(v, (), float(rng.uniform(1, 2))) for v in vehicles for _ in "123")
    savings = {
        (i, j): float(rng.uniform(-0.4, 0.8))
        for i, j in combinations(range(12), 2)
        if options[i].vehicle != options[j].vehicle
    }
    problem = RouteProblem(vehicles, (), options, savings)
    start = frozenset({0, 3, 6, 9})
    found = improved(problem, start, ["a", "c"])
    every = [frozenset({i, 3, j, 9}) for i in range(3) for j in range(6, 9)]
    assert found == min(every, key=problem.objective_kwh)


def test_blocks_meet_the_undivided_optimum_where_nothing_ties_them() -> None:
    """Two pairs of vehicles that save only within the pair: two blocks lose nothing."""
    options = tuple(RouteOption(v, (), c) for v in "abcd" for c in (1.0, 1.1))
    problem = RouteProblem(tuple("abcd"), (), options, {(1, 3): 0.5, (5, 7): 0.3})
    graph = nx.Graph([("a", "b", {"weight": 1.0}), ("c", "d", {"weight": 1.0})])
    told = measure_gap(problem, graph, CitySettings(), 10.0)
    gap = Gap(seed=1, vehicles=4, **told)  # type: ignore[arg-type]
    assert (gap.blocks, gap.variables, gap.proven) == (2, 8, True)
    assert gap.start_kwh == pytest.approx(4.0)
    assert gap.sweep_kwh == pytest.approx(4.4 - 0.8)
    assert (gap.share, gap.gained) == (0.0, 1.0)


def test_report_tells_where_the_energy_is_saved() -> None:
    """Distance, drag and acceleration as shares of what the baseline needs; they add up."""
    text = markdown(GOOD, {"machine": "m"})
    assert "| 1.50 % | -1.00 % | 2.00 % | 0.50 % | 0.12 % | +1.00 % |" in text
    assert "MISSED" not in text
    assert "2 instances of 25 variables" in text
    assert "| exact | 0.0550 | 0.0600 | 2 of 2 | 0.00 % | 0.00 % | 0 |" in text
    assert "| tabu | 0.0200 | 0.0200 | 0 of 2 | 10.00 % | 10.00 % | 0 |" in text


def test_report_as_json_holds_all_runs(tmp_path: Path) -> None:
    """Whoever doubts a figure can compute it anew."""
    report.write(tmp_path, replace(GOOD, missing=("a run: why",)), {"machine": "m"})
    told = json.loads((tmp_path / "report.json").read_text())
    assert told["rivals"][1] == asdict(GOOD.rivals[1])
    assert len(told["fixed"]) == 9
    assert "**not measured:** a run: why" in (tmp_path / "report.md").read_text()


@dataclass(frozen=True)
class Told:
    """A solver that answers what it was told, by seed."""

    selections: tuple[frozenset[int] | None, ...]
    name: str = "told"

    def warm_up(self) -> None:
        """Nothing to do."""

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """The selection of that seed, always called optimal."""
        return Outcome(self.name, "optimal", self.selections[seed - 1], 0.0)


def test_an_answer_is_judged_by_its_worst_repeat() -> None:
    """Objectives are evaluated here, whatever a solver claims; an invalid answer is none."""
    options = (RouteOption("a", (), 1.0), RouteOption("a", (), 3.0), RouteOption("b", (), 0.5))
    problem = RouteProblem(("a", "b"), (), options, {(1, 2): 0.25})
    good, worse, invalid = frozenset({0, 2}), frozenset({1, 2}), frozenset({0, 1, 2})
    found = answer(Told((good, worse)), problem, 2)
    assert (found.objective_kwh, found.optimal, len(found.wall_s)) == (3.25, True, 2)
    assert answer(Told((good, invalid)), problem, 2).objective_kwh is None
    assert answer(Told((None,)), problem, 1).objective_kwh is None


@pytest.mark.slow
def test_plots_are_drawn_for_what_was_measured(tmp_path: Path) -> None:
    """Two pictures of some size; none without figures."""
    drawn = draw(GOOD, tmp_path)
    assert [path.name for path in drawn] == ["routing-scaling.png", "routing-rivals.png"]
    assert all(path.stat().st_size > 10_000 for path in drawn)
    assert draw(RoutingResults(city=(RUN,)), tmp_path) == []


@pytest.mark.process
def test_memory_of_a_tree_of_processes(tmp_path: Path) -> None:
    """A child's 60 MB count although the parent itself has none of them."""
    child = "b = b'1' * 60_000_000; import time; time.sleep(1.5)"
    parent = (
        f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}]); print('[1]')"
    )
    told, peak = watched([sys.executable, "-c", parent], tmp_path / "log", 20.0)
    assert told == [1]
    assert 60 < peak < 200
    assert tree_mb(2**22 + 1) == 0.0


@pytest.mark.process
@pytest.mark.parametrize("code", ["raise SystemExit(3)", "pass", "import time; time.sleep(60)"])
def test_a_run_that_tells_nothing_is_an_error(code: str, tmp_path: Path) -> None:
    """It failed, printed nothing, or did not end."""
    with pytest.raises(RuntimeError, match="log"):
        watched([sys.executable, "-c", code], tmp_path / "log", 0.5)


def test_cities_of_the_slope_keep_their_proportions() -> None:
    """Five stops a vehicle, on the same network."""
    assert CitySize(200, 1000, 2000).with_vehicles(10) == CitySize(10, 50, 2000)


def test_the_full_form_is_that_of_the_aims() -> None:
    """What is aimed at is what is measured; the short form is smaller."""
    assert FULL.city == CitySize(200, 1000, 2000)
    assert (FULL.budget_s, FULL.best_s, len(FULL.rival_seeds)) == (30.0, 600.0, 20)
    assert (FULL.fleets[0], FULL.fleets[-1]) == (10, 500)
    assert SHORT.city.vehicles < FULL.city.vehicles


def test_parts_are_measured_in_their_order() -> None:
    """However they are given; an unknown one is a mistake of the user's."""
    assert parts_of("rivals,instances", PARTS) == ("instances", "rivals")
    with pytest.raises(InputError, match="no part 'all'"):
        parts_of("all", PARTS)
    assert main(["--only", "all"]) == 2


@pytest.mark.long
@pytest.mark.process
def test_a_small_city_is_measured_in_a_process_of_its_own(tmp_path: Path) -> None:
    """All figures of a run come from the cycle itself; saved parts add up to what was saved."""
    size = ["--vehicles", "4", "--stops", "12", "--segments", "60"]
    module = [sys.executable, "-m", "slipstream_lab.benchmarks.routing.city_run"]
    options = ["--seed", "2", *size, "--budget", "10", "--solver-seed", "1", "--rival", "1"]
    told, peak = watched([*module, *options], tmp_path / "log", 200.0)
    run = CityRun(**told, peak_mb=peak)
    assert (run.vehicles, run.stops, run.segments, run.unserved) == (4, 12, 60, 0)
    assert run.objective_kwh == pytest.approx(run.cost_kwh - run.saving_kwh)
    assert run.objective_kwh <= run.base_met_kwh + 1e-9 <= run.base_kwh + 2e-9
    assert sum(run.stages_s.values()) <= run.wall_s
    assert run.saved_drag_kwh >= 0
    assert run.rival_kwh == pytest.approx(run.base_kwh, rel=0.02)
    assert 50 < peak < 2000


def test_what_a_city_could_choose_is_one_problem() -> None:
    """Every vehicle of the city is in it, its base route first."""
    problem, graph = undivided(generate_city(1, vehicles=6, stops=30, segments=100), 1)
    assert len(problem.vehicles) == 6
    assert set(graph) <= set(problem.vehicles)
    assert all(problem.options_of[vehicle] for vehicle in problem.vehicles)
    assert problem.choices > 6


@pytest.mark.long
@pytest.mark.process
def test_published_instances_are_read_and_searched(tmp_path: Path) -> None:
    """Four customers in two corners, of which a vehicle takes two: 2 · (√2 · 10 + 1 + √221) each,
    cut to tenths; the same in VRPLIB's form, with distances rounded.
    """
    at = [(0, 0), (10, 10), (10, 11), (-10, -10), (-10, -11)]
    rows = [f"{i} {x} {y} {min(i, 1)} 0 200 0" for i, (x, y) in enumerate(at)]
    solomon = tmp_path / "corners.txt"
    solomon.write_text(
        "corners\n\nVEHICLE\nNUMBER CAPACITY\n3 2\n\nCUSTOMER\nCUST NO. XCOORD. YCOORD. DEMAND "
        "READY TIME DUE DATE SERVICE TIME\n\n" + "\n".join(rows) + "\n"
    )
    cvrp = tmp_path / "C-n5-k2.vrp"
    coordinates = "\n".join(f"{i} {x} {y}" for i, (x, y) in enumerate(at, 1))
    demands = "\n".join(f"{i} {min(i - 1, 1)}" for i in range(1, 6))
    cvrp.write_text(
        "NAME : C-n5-k2\nTYPE : CVRP\nDIMENSION : 5\nEDGE_WEIGHT_TYPE : EUC_2D\nCAPACITY : 2\n"
        f"NODE_COORD_SECTION\n{coordinates}\nDEMAND_SECTION\n{demands}\nDEPOT_SECTION\n1\n-1\nEOF\n"
    )
    cvrp.with_suffix(".sol").write_text("Route #1: 1 2\nRoute #2: 3 4\nCost 60\n")
    settings = SearchSettings(rounds=1)
    assert "60.0, 0 unserved" in (told := published.measure(cvrp, settings, 1))
    assert "0.00 % above 60;" in told
    assert "59.8, 0 unserved;" in published.measure(solomon, settings, 1)


def test_nobody_drafts_more_than_everybody_who_follows() -> None:
    """Longer windows and more open gates save more; so does any plan less than the last ceiling."""
    city = generate_city(2, vehicles=16, stops=48, segments=100)
    vehicles = city.problem.fleet.vehicles
    stops = [stop.id for stop in city.problem.fleet.stops]
    visits = {v.id: tuple(stops[n::16]) for n, v in enumerate(vehicles)}
    travel = fleet_travel(city.problem, city.snapshot)
    base = initial_plans(instance_cycle(city, 1), travel, visits, {}).base
    drives = exact_drives(city, base)
    alone = measured(city, drives, {})[0]
    together = form_platoons(
        drives, city.snapshot, city.sync_window_s, city.problem.longest_platoon, 1
    )
    minute, ten, opened, everywhere = ceilings_kwh(city, drives)
    assert WINDOWS_S == (60.0, 600.0)
    assert alone >= measured(city, drives, together)[0] >= minute > ten > opened > everywhere
    assert (alone - everywhere) / alone < 0.2
