from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise, product

import networkx as nx
import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.cycle.cycle import run_cycle
from dispatcher_daemon.planning.plans.candidates import Cycle
from dispatcher_daemon.planning.roads.arrays import Roads, roads_of
from dispatcher_daemon.planning.roads.charge import leg_energy_kwh
from dispatcher_daemon.planning.roads.costs import held_cost_kwh
from dispatcher_daemon.planning.roads.routes import RoadLeg
from dispatcher_daemon.planning.roads.travel import Travel, leg_along
from dispatcher_daemon.settings import CitySettings, DispatcherSettings, SearchSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from dispatcher_daemon.traffic.snapshot import Expectations, TrafficSnapshot
from slipstream.energy.consumption import PAPER_CAR, drive_energies, stop_energy_kwh
from slipstream_lab.research.cities.generator import small_city

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
PLACES = ("11", "33", "20", "02")


def expected_of(problem: RoutingProblem, seed: int, share: float = 1.0) -> Expectations:
    """Losses and times drawn for a share of all movements."""
    rng = np.random.default_rng(seed)
    network = problem.network
    pairs = [(a, b) for a in sorted(network.segments) for b in network.turns(a)]
    known = [pair for pair in pairs if rng.random() < share]
    return Expectations(
        {pair: float(rng.uniform(0.01, 0.3)) for pair in known},
        {pair: float(rng.uniform(5.0, 120.0)) for pair in known},
    )


def legs_of(travel: Travel) -> list[tuple[tuple[int, int], RoadLeg]]:
    """Every path between two places with its pair in the matrices."""
    found = []
    for start, end in product(travel.places, repeat=2):
        leg = travel.leg(start, end)
        if leg is not None and leg.path:
            found.append(((travel.row[start], travel.row[end]), leg))
    assert found
    return found


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_ways_are_those_of_least_expected_losses(town: Town, share: float) -> None:
    """With expectations every pair costs what networkx finds over movements, those that nobody has
    seen costing what their segment does, and the braking at the end comes on top.
    """
    problem, snapshot = town(PLACES, [{}], seed=3)
    problem = replace(problem, objective="paper")
    expected = expected_of(problem, 1, share)
    snapshot = replace(snapshot, expected=expected)
    network, traffic = problem.network, snapshot.segments
    cost = {
        n: held_cost_kwh(s, traffic[n], problem.profiles[0]) for n, s in network.segments.items()
    }
    graph = nx.DiGraph()
    for name, segment in network.segments.items():
        for after in network.turns(name):
            graph.add_edge(name, after, kwh=expected.loss_kwh.get((name, after), cost[name]))
        graph.add_edge(f"from {segment.start}", name, kwh=0.0)
        braking = stop_energy_kwh(traffic[name].speed_mps, problem.vehicle)
        graph.add_edge(name, f"to {segment.end}", kwh=cost[name] + braking)
    travel = Travel(problem, roads_of(problem, snapshot))
    for (i, j), leg in legs_of(travel):
        a, b = (problem.fleet.node(place) for place in (leg.start, leg.end))
        least = nx.dijkstra_path_length(graph, f"from {a}", f"to {b}", weight="kwh")
        assert travel.energy_kwh[i, j] == pytest.approx(least, abs=1e-9)
        assert leg.cost_kwh == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.6])
def test_energy_is_one_measure_whatever_was_minimised(town: Town, share: float) -> None:
    """The same path has the same energy under both objectives, what stops, turbulence and observed
    movements add included, though it does not cost the same.
    """
    problem, snapshot = town(PLACES, [{}], seed=3)
    traffic = {
        name: replace(
            t, y_e=0, measured_speed_mps=t.speed_mps, acceleration_variance_m2ps4=1.0, stops=0.5
        )
        for name, t in snapshot.segments.items()
    }
    snapshot = replace(snapshot, segments=traffic)
    if share:
        snapshot = replace(snapshot, expected=expected_of(problem, 1, share))
    by = {
        of: Travel(asked := replace(problem, objective=of), roads_of(asked, snapshot))
        for of in ("paper", "energy")
    }
    roads, differ = by["energy"].roads, 0
    for _, leg in legs_of(by["paper"]):
        path = [roads.index[segment] for segment in leg.path]
        same = leg_along(roads, path, leg.start, leg.end, problem.style)
        energy_kwh = leg_energy_kwh(leg, problem.vehicle)
        assert energy_kwh == pytest.approx(leg_energy_kwh(same, problem.vehicle))
        differ += abs(leg.cost_kwh - same.cost_kwh) > 1e-6
        if not share:
            assert leg.beyond_kwh > 0
    assert differ > 0


def test_waiting_at_signals_is_in_the_timetable(town: Town) -> None:
    """A leg takes the expected time of its movements, but is nowhere faster than planning speeds
    allow; it enters each segment after the one before, and the matrix agrees.
    """
    problem, snapshot = town(PLACES, [{}], seed=3)
    expected = expected_of(problem, 2)
    plain = Travel(problem, roads_of(problem, snapshot))
    roads = roads_of(problem, replace(snapshot, expected=expected))
    travel = Travel(problem, roads)
    later = 0
    for (i, j), leg in legs_of(travel):
        path = [roads.index[name] for name in leg.path]
        free = leg_along(plain.roads, path, leg.start, leg.end, problem.style)
        times = [*leg.drive.entry_s, leg.drive.duration_s]
        assert times[0] == 0.0
        spent = np.diff(times)
        assert (spent > 0).all()
        unhindered = np.diff([*free.drive.entry_s, free.drive.duration_s])
        assert (spent >= unhindered - 1e-9).all()
        for passed, pair in zip(spent[1:-1], list(pairwise(leg.path))[1:], strict=True):
            assert passed > expected.seconds[pair] - 2.0
        later += leg.drive.duration_s > free.drive.duration_s + 1.0
        assert travel.duration_s[i, j] == pytest.approx(leg.drive.duration_s, abs=1.0)
    assert later > 0


@pytest.mark.parametrize("known", [False, True])
def test_shortest_times_are_shortest_and_cost_more(known: bool) -> None:
    """Between all places of a city, the search for time takes no longer and needs no less than the
    one for energy; one that gives time a worth lies between them.
    """
    city = small_city(1)
    snapshot = city.snapshot
    if known:
        snapshot = replace(snapshot, expected=expected_of(city.problem, 5))
    by = {
        name: Travel(problem, roads_of(problem, snapshot))
        for name, problem in (
            ("energy", city.problem),
            ("both", replace(city.problem, price_of_time_kw=3.0)),
            ("time", replace(city.problem, search="time")),
        )
    }
    for one, other in pairwise(by):
        assert (by[one].energy_kwh <= by[other].energy_kwh + 1e-9).all()
        assert (by[one].duration_s >= by[other].duration_s - 1e-6).all()
        assert by[one].energy_kwh.sum() < by[other].energy_kwh.sum()
        assert by[one].duration_s.sum() > by[other].duration_s.sum()
    np.testing.assert_allclose(by["time"].search_cost_kwh, by["time"].duration_s / 3600)
    np.testing.assert_allclose(
        by["both"].search_cost_kwh, by["both"].energy_kwh + 3.0 / 3600 * by["both"].duration_s
    )


def test_a_worth_below_zero_is_refused() -> None:
    """Time on the road is never worth having."""
    with pytest.raises(ValueError, match="price_of_time_kw"):
        replace(small_city(1).problem, price_of_time_kw=-1.0)


@pytest.mark.long
@pytest.mark.slow
def test_a_cycle_with_expectations_gives_verified_plans() -> None:
    """Plans made with expectations pass verification, leave in time and cost what is expected."""
    city = small_city(3)
    snapshot = replace(city.snapshot, expected=expected_of(city.problem, 6))
    settings = DispatcherSettings(
        form="route",
        solvers=("exact",),
        city=CitySettings(
            search=SearchSettings(rounds=1, iterations_per_stop=5, workers=1),
            second_rounds=0,
            max_sweeps=1,
        ),
    )
    problem = replace(city.problem, price_of_time_kw=5.0)
    solve = solve_in_process([ExactSolver()])
    this = Cycle(problem, snapshot, settings, 1, 0, 1, reference_delay_s=0.0)
    result = run_cycle(this, solve)
    assert result.report.status == "ok"
    assert result.plans
    windows = {v.id: (v.ready_s, v.depart_by_s) for v in problem.fleet.vehicles}
    losses = snapshot.expected.loss_kwh if snapshot.expected is not None else {}
    for plan in result.plans:
        least = sum(
            losses[a.segment, b.segment] for a, b in pairwise(plan.segments) if a.leg == b.leg
        )
        low, high = windows[plan.vehicle]
        assert low <= plan.depart_ns * 1e-9 <= (high or low)
        assert plan.energy_kwh > 0.8 * least


def long_roads(town: Town, seed: int, price_kw: float = 0.0) -> tuple[RoutingProblem, Roads]:
    """A town whose roads are long enough for all changes of speed, with stops expected on some."""
    problem, snapshot = town(PLACES, [{}], seed=seed)
    rng = np.random.default_rng(seed)
    network = problem.network
    longer = {
        name: replace(segment, length_m=segment.length_m + 400.0)
        for name, segment in network.segments.items()
    }
    traffic = {
        name: replace(t, speed_mps=float(rng.uniform(6.0, 16.0)), stops=float(rng.choice([0, 0.4])))
        for name, t in snapshot.segments.items()
    }
    problem = replace(problem, network=replace(network, segments=longer), price_of_time_kw=price_kw)
    return problem, roads_of(problem, replace(snapshot, segments=traffic))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_path_costs_its_exact_drive(town: Town, seed: int) -> None:
    """Where roads are long, the sum over turns is the energy of the drive and of its stops; a leg
    costs that and the price of its time.
    """
    problem, roads = long_roads(town, seed, price_kw=3.0)
    travel = Travel(problem, roads)
    stopping = 0
    for (i, j), leg in legs_of(travel):
        drive_kwh = drive_energies([leg.drive], [[0.0] * len(leg.path)]).sum().total_kwh
        path = [roads.index[name] for name in leg.path]
        stops_kwh = roads.cost(roads.costs.expected, path)
        assert leg.beyond_kwh == pytest.approx(stops_kwh)
        assert travel.energy_kwh[i, j] == pytest.approx(drive_kwh + stops_kwh, rel=1e-9)
        assert leg.cost_kwh == pytest.approx(
            drive_kwh + stops_kwh + 3.0 * leg.drive.duration_s / 3600
        )
        assert travel.search_cost_kwh[i, j] == pytest.approx(leg.cost_kwh, rel=1e-3)
        stopping += stops_kwh > 0
    assert stopping > 0


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_the_search_knows_the_energy_of_a_citys_drives(seed: int) -> None:
    """Between all places of a city the searched energy is the exact one, to 4 % in 95 of 100."""
    city = small_city(seed)
    travel = Travel(city.problem, roads_of(city.problem, city.snapshot))
    ratios = [
        travel.energy_kwh[pair] / leg_energy_kwh(leg, city.problem.vehicle)
        for pair, leg in legs_of(travel)
    ]
    low, middle, high = np.percentile(ratios, [2.5, 50, 97.5])
    assert 0.98 < low <= high < 1.04
    assert middle == pytest.approx(1.0, abs=0.005)


def test_the_arrival_is_no_stop(town: Town) -> None:
    """A stop that is expected at a leg's end costs nothing: the vehicle stands there anyway."""
    problem, snapshot = town(PLACES, [{}], seed=1)
    everywhere = {name: replace(t, stops=1.0) for name, t in snapshot.segments.items()}
    calm = roads_of(problem, snapshot)
    busy = roads_of(problem, replace(snapshot, segments=everywhere))
    for name in calm.ids:
        legs = [leg_along(r, [r.index[name]], "a", "b", problem.style) for r in (calm, busy)]
        assert legs[0] == legs[1]
    a, b = (int(i) for i in calm.turn[:, 0])
    legs = [leg_along(r, [a, b], "a", "b", problem.style) for r in (calm, busy)]
    assert (
        legs[1].cost_kwh
        > legs[0].cost_kwh
        + 0.9 * stop_energy_kwh(min(calm.speed_mps[[a, b]]), problem.vehicle)
        - calm.cost_kwh[[a, b]].sum()
    )
    assert legs[1].drive.duration_s > legs[0].drive.duration_s + 5.0
    assert legs[1].drive.entry_s[1] > legs[0].drive.entry_s[1] + 5.0


@pytest.mark.parametrize("recuperation", [0.0, 0.6])
def test_movements_that_nobody_has_seen_cost_their_drive(town: Town, recuperation: float) -> None:
    """With expectations of nothing, paths cost what they do without: what gaining speed takes is
    counted where it is lost again.
    """
    physics = replace(PAPER_CAR, recuperation_efficiency=recuperation)
    problem, snapshot = town(PLACES, [{}], seed=2)
    problem = replace(problem, vehicle=physics)
    roads = roads_of(problem, snapshot)
    unseen = roads_of(problem, replace(snapshot, expected=Expectations({}, {})))
    for _, leg in legs_of(Travel(problem, roads)):
        path = [roads.index[name] for name in leg.path]
        gained = roads.cost(roads.costs.energy, path)
        assert unseen.cost(unseen.costs.energy, path) == pytest.approx(gained, rel=0.03)
        assert leg.cost_kwh > 0
