from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.improvement.options import options_for
from dispatcher_daemon.planning.improvement.sweeps import choice_of
from dispatcher_daemon.planning.platooning.meetings import Meetings
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]


def present_plan(town: Town, **first: object) -> tuple[Planner, list[Itinerary], Meetings]:
    """Three vans with two stops each on their way, and two sets of ways."""
    vans = [
        {"depart_by_s": 120.0, **first},
        {"ready_s": 30.0, "depart_by_s": 150.0},
        {"ready_s": 70.0},
    ]
    problem, snapshot = town(["33", "03", "33", "32", "23", "33"], vans, seed=4)
    roads = roads_of(problem, snapshot)
    lured = Travel(problem, roads, 0.5 * roads.cost_kwh * (np.arange(len(roads.ids)) % 2))
    planner = Planner(problem, snapshot, [Travel(problem, roads), lured], 3.0)
    meetings, present = Meetings(planner.book.shares, 3.0, planner.book.longest), []
    for n in range(3):
        stops = (f"s{2 * n}", f"s{2 * n + 1}")
        itinerary = planner.itinerary(n, stops, planner.legs(n, stops))
        assert itinerary is not None
        meetings.add(itinerary.traversals)
        present.append(itinerary)
    return planner, present, meetings


@pytest.mark.parametrize("seed", range(4))
def test_options_are_few_distinct_and_feasible(town: Town, seed: int) -> None:
    """The present one comes first, none twice, no more than asked for, and all for this vehicle,
    over the same stops, within its window; the road is left as it was.
    """
    planner, present, meetings = present_plan(town)
    before = {s: list(meetings.on(s)) for s in planner.book.shares}
    options = options_for(planner, present[0], present, meetings, 5, np.random.default_rng(seed))
    assert options[0] is present[0]
    assert 2 <= len(options) <= 5
    assert len({option.key for option in options}) == len(options)
    low, high = planner.windows.of(0)
    for option in options:
        assert (option.number, set(option.stops)) == (0, {"s0", "s1"})
        assert low - 1e-9 <= option.depart_s <= high + 1e-9
    assert {s: list(meetings.on(s)) for s in planner.book.shares} == before


@pytest.mark.slow
def test_the_best_answer_to_the_others_is_among_the_options(town: Town) -> None:
    """Two options hold one that is as good as the best of all orders, ways and many departures."""
    planner, present, meetings = present_plan(town)
    options = options_for(planner, present[0], [], meetings, 2, np.random.default_rng(1))

    def objective_kwh(candidate: Itinerary) -> float:
        return choice_of(planner, [candidate, *present[1:]]).objective_kwh

    tried = []
    for stops, travel, depart_s in product(
        (("s0", "s1"), ("s1", "s0")), (0, 1), np.arange(0.0, 120.0, 2.0)
    ):
        legs = planner.legs(0, stops, travel)
        candidate = planner.itinerary(0, stops, legs, float(depart_s))
        assert candidate is not None
        tried.append(objective_kwh(candidate))
    found = min(objective_kwh(option) for option in options)
    assert found <= min(tried) + 1e-9
    assert found < objective_kwh(present[0]) - 1e-6


def test_a_loaded_parcel_comes_first_in_every_option(town: Town) -> None:
    """The stops of a vehicle with a first stop are never turned round; those of others are."""
    rng = np.random.default_rng(2)
    for first, orders in (({"first_stop": "s0"}, 1), ({}, 2)):
        planner, present, meetings = present_plan(town, **first)
        options = options_for(planner, present[0], present, meetings, 50, rng)
        assert len({option.stops for option in options}) == orders


def test_vehicles_that_can_only_meet_if_both_move_get_the_departure_for_it(town: Town) -> None:
    """The earlier van can wait until the later one may leave: that departure is an option of its
    own, though nobody is there to be met yet.
    """
    vans = [{"depart_by_s": 120.0}, {"ready_s": 30.0, "depart_by_s": 150.0}]
    problem, snapshot = town(["33", "33"], vans)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    meetings, present = Meetings(planner.book.shares, 3.0, planner.book.longest), []
    for n, depart_s in enumerate((0.0, 150.0)):
        itinerary = planner.itinerary(n, (f"s{n}",), planner.legs(n, (f"s{n}",)), depart_s)
        assert itinerary is not None
        meetings.add(itinerary.traversals)
        present.append(itinerary)
    rng = np.random.default_rng(1)
    own, other = (options_for(planner, p, present, meetings, 5, rng) for p in present)
    assert any(option.depart_s == pytest.approx(30.0) for option in own)
    assert any(option.depart_s == pytest.approx(30.0) for option in other)
