from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations, product

import numpy as np
import pytest

from dispatcher_daemon.forms.decode import violations
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.improvement.blocks import Block, build_block
from dispatcher_daemon.planning.improvement.sweeps import choice_of
from dispatcher_daemon.planning.platooning.meetings import Meetings
from dispatcher_daemon.planning.platooning.platoons import form_platoons
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
VANS = 7
MEMBERS = (0, 2, 3, 5)


def crowd(town: Town, seed: int) -> tuple[Planner, list[list[Itinerary]]]:
    """Options of seven vans that leave one depot within seconds for the same corner."""
    rng = np.random.default_rng(seed)
    problem, snapshot = town(
        ["33", "32", "33", "23", "33", "33", "31"], [{"depart_by_s": 20.0}] * VANS, seed=seed
    )
    roads = roads_of(problem, snapshot)
    lured = Travel(problem, roads, 0.6 * roads.cost_kwh * (rng.random(len(roads.ids)) < 0.5))
    planner = Planner(problem, snapshot, [Travel(problem, roads), lured], 3.0)
    options = []
    for number in range(VANS):
        stops = (f"s{number}",)
        of_one = [
            planner.itinerary(
                number, stops, planner.legs(number, stops, int(rng.integers(2))), float(depart_s)
            )
            for depart_s in rng.integers(0, 10, 4)
        ]
        options.append([option for option in of_one if option is not None])
    return planner, options


def block_of(
    planner: Planner, present: Sequence[Itinerary], options: Mapping[int, Sequence[Itinerary]]
) -> Block:
    """A block around the present plan."""
    meetings = Meetings(planner.book.shares, planner.book.sync_window_s, planner.book.longest)
    for itinerary in present:
        meetings.add(itinerary.traversals)
    return build_block({n: f"van-{n}" for n in range(len(present))}, options, meetings)


def largest_platoon(planner: Planner, itineraries: Sequence[Itinerary]) -> int:
    """Members of the largest platoon that forms."""
    routes = [i.route for i in itineraries if i.route is not None]
    places = form_platoons(
        routes, planner.snapshot, planner.book.sync_window_s, planner.book.longest, 1
    )
    return 1 + max(place.number for place in places.values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_every_change_of_one_or_two_vehicles_is_exact(town: Town, seed: int) -> None:
    """The block's objective changes as that of the whole fleet evaluated from nothing does, with
    platoons of three and more about, and vehicles in them that are not in the block.
    """
    planner, every = crowd(town, seed)
    present = [of_one[0] for of_one in every]
    block = block_of(planner, present, {n: every[n] for n in MEMBERS})
    problem = block.problem
    groups = list(problem.options_of.values())
    stay = frozenset(group[0] for group in groups)
    start = choice_of(planner, present).objective_kwh
    largest = 0
    for k, m in combinations(range(len(MEMBERS)), 2):
        for a, b in product(groups[k], groups[m]):
            selected = stay - {groups[k][0], groups[m][0]} | {a, b}
            moved = {i.number: i for i in block.chosen(selected)}
            fleet = [moved.get(i.number, i) for i in present]
            largest = max(largest, largest_platoon(planner, fleet))
            exact = choice_of(planner, fleet).objective_kwh - start
            estimated = problem.objective_kwh(selected) - problem.objective_kwh(stay)
            assert estimated == pytest.approx(exact, abs=1e-12)
            assert violations(problem, selected) == ()
    assert largest >= 3


def test_savings_that_two_cannot_both_have_are_taken_back(town: Town) -> None:
    """Where both could lead the same follower, the pair's extra is less than 0."""
    signs = set()
    for seed in range(6):
        planner, every = crowd(town, seed)
        present = [of_one[0] for of_one in every]
        block = block_of(planner, present, {n: every[n] for n in MEMBERS})
        signs |= {value > 0 for value in block.problem.savings.values()}
    assert signs == {True, False}


def test_the_present_plan_costs_what_it_costs_alone(town: Town) -> None:
    """First options keep their own cost, and nothing is saved between them: they are the origin
    of the expansion. A selection reads back as the itineraries it stands for.
    """
    planner, every = crowd(town, 1)
    present = [of_one[0] for of_one in every]
    block = block_of(planner, present, {n: every[n] for n in MEMBERS})
    stay = [group[0] for group in block.problem.options_of.values()]
    for index, number in zip(stay, MEMBERS, strict=True):
        assert block.problem.options[index].cost_kwh == present[number].cost_kwh
    assert not any(a in stay or b in stay for a, b in block.problem.savings)
    assert block.chosen(frozenset(stay)) == [present[n] for n in MEMBERS]
    assert block.problem.vehicles == tuple(f"van-{n}" for n in MEMBERS)
    assert block.problem.stops == ()


def test_stops_that_change_hands_are_covered_once(town: Town) -> None:
    """Where options differ in stops, exactly these are asked for: whoever takes one over needs
    the other to let it go, and the exact solver's answer serves all.
    """
    problem, snapshot = town(["33", "03", "30", "32"], [{"capacity": 9}] * 3)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)

    def serve(number: int, *stops: str) -> Itinerary:
        itinerary = planner.itinerary(number, stops, planner.legs(number, stops))
        assert itinerary is not None
        return itinerary

    present = [serve(0, "s0", "s1"), serve(1, "s2"), serve(2, "s3")]
    options = {
        0: [present[0], serve(0, "s0"), serve(0, "s0", "s3", "s1")],
        1: [present[1], serve(1, "s1", "s2")],
        2: [present[2], planner.idle(2)],
    }
    block = block_of(planner, present, options)
    assert block.problem.stops == ("s1", "s3")
    assert [option.stops for option in block.problem.options] == [
        ("s1",), (), ("s3", "s1"), (), ("s1",), ("s3",), (),
    ]  # fmt: skip
    valid = {
        chosen
        for chosen in map(frozenset, product((0, 1, 2), (3, 4), (5, 6)))
        if not violations(block.problem, chosen)
    }
    assert valid == {frozenset({0, 3, 5}), frozenset({1, 4, 5}), frozenset({2, 3, 6})}
    answer = ExactSolver().solve(block.problem, 5.0, 1).selected
    assert answer is not None
    best = min(valid, key=lambda c: choice_of(planner, block.chosen(c)).objective_kwh)
    assert answer == best
    served = sorted(stop for i in block.chosen(answer) for stop in i.stops)
    assert served == ["s0", "s1", "s2", "s3"]
