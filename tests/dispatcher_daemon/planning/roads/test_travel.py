from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import islice, pairwise, product

import networkx as nx
import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.roads.arrays import Roads, roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream_lab.research.cities.generator import small_city

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]
PLACES = ("11", "33", "20", "33", "02", "q")


def made(town: Town, seed: int) -> tuple[RoutingProblem, Roads, Travel]:
    """A town with stops here and there, two at one junction, one out of reach; a path costs what
    its segments do.
    """
    problem, snapshot = town(PLACES, [{}], seed=seed)
    problem = replace(problem, objective="paper")
    roads = roads_of(problem, snapshot)
    return problem, roads, Travel(problem, roads)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_energies_are_those_of_the_cheapest_legal_paths(town: Town, seed: int) -> None:
    """Every pair costs what networkx finds over segments and turns; the leg adds up to it."""
    problem, roads, travel = made(town, seed)
    network = problem.network
    cost = dict(zip(roads.ids, roads.cost_kwh, strict=True))
    graph = nx.DiGraph()
    for name in roads.ids:
        graph.add_edges_from((name, after, {"kwh": cost[after]}) for after in network.turns(name))
    for node in network.junctions:
        graph.add_edges_from(
            (f"from {node}", s.id, {"kwh": cost[s.id]}) for s in network.leaving[node]
        )
    for start, end in product(travel.places, repeat=2):
        a, b = problem.fleet.node(start), problem.fleet.node(end)
        if a == b:
            continue
        distance = nx.single_source_dijkstra_path_length(graph, f"from {a}", weight="kwh")
        into = [distance[s] for s in roads.ids if network.segments[s].end == b and s in distance]
        found = travel.energy_kwh[travel.row[start], travel.row[end]]
        leg = travel.leg(start, end)
        if not into:
            assert leg is None
            continue
        assert found == pytest.approx(min(into), rel=1e-12)
        assert leg is not None
        assert (leg.start, leg.end) == (start, end)
        assert leg.cost_kwh == pytest.approx(found, rel=1e-12)
        assert network.segments[leg.path[0]].start == a
        assert network.segments[leg.path[-1]].end == b
        assert all(after in network.turns(before) for before, after in pairwise(leg.path))


def test_the_cheapest_ways_are_those_of_networkx(town: Town) -> None:
    """The k cheapest loopless paths in order, the first being the leg; none without a path."""
    problem, roads, travel = made(town, 2)
    network = problem.network
    cost = dict(zip(roads.ids, roads.cost_kwh, strict=True))
    graph = nx.DiGraph()
    for name in roads.ids:
        graph.add_edges_from((name, after, {"kwh": cost[after]}) for after in network.turns(name))
    graph.add_edges_from(("out", s.id, {"kwh": cost[s.id]}) for s in network.leaving["00"])
    graph.add_edges_from(
        (s, "in", {"kwh": 0.0}) for s in roads.ids if network.segments[s].end == "33"
    )
    expected = list(islice(nx.shortest_simple_paths(graph, "out", "in", "kwh"), 5))
    found = travel.paths("depot-0", "s1", 5)
    assert [leg.path for leg in found] == [tuple(path[1:-1]) for path in expected]
    assert found[0] == travel.leg("depot-0", "s1")
    for leg in found:
        assert leg.cost_kwh == pytest.approx(sum(cost[s] for s in leg.path))
    assert travel.paths("depot-0", "s5", 5) == travel.paths("s1", "s3", 5) == []


def test_what_cannot_be_reached_is_infinitely_far(town: Town) -> None:
    """Between the town and the road apart there is no path: inf in all matrices, no leg."""
    _, _, travel = made(town, 1)
    apart = travel.row["s5"]
    for matrix in (travel.energy_kwh, travel.search_cost_kwh, travel.duration_s):
        assert np.isinf(np.delete(matrix[apart], apart)).all()
        assert np.isinf(np.delete(matrix[:, apart], apart)).all()
        assert np.isfinite(np.delete(np.delete(matrix, apart, 0), apart, 1)).all()
    assert travel.leg("depot-0", "s5") is None
    assert travel.leg("s5", "s0") is None


def test_paths_do_not_depend_on_how_many_are_searched_at_once(
    town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A junction at a time, the matrices are the same."""
    problem, roads, whole = made(town, 1)
    monkeypatch.setattr("dispatcher_daemon.planning.roads.all_pairs._SEARCHED_AT_ONCE", 1)
    single = Travel(problem, roads)
    for name in ("search_cost_kwh", "duration_s", "energy_kwh"):
        np.testing.assert_array_equal(getattr(single, name), getattr(whole, name))


def test_a_search_that_may_not_go_on_ends_without_ways(
    town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is asked after each part but the last, with the share that is done."""
    problem, roads, travel = made(town, 1)
    monkeypatch.setattr("dispatcher_daemon.planning.roads.all_pairs._SEARCHED_AT_ONCE", 1)
    asked: list[float] = []

    def until(share: float) -> Callable[[float], bool]:
        asked.clear()

        def may_go_on(done: float) -> bool:
            asked.append(done)
            return done < share

        return may_go_on

    n = len(travel.duration_s)
    Travel(problem, roads, may_go_on=until(1.0))
    assert asked == [i / n for i in range(1, n)]
    with pytest.raises(TimeoutError, match=f"3 of {n}"):
        Travel(problem, roads, may_go_on=until(3 / n))
    assert asked == [i / n for i in range(1, 4)]


def test_places_at_one_junction_have_no_way_between_them(town: Town) -> None:
    """Two stops at one junction: nothing to drive, and the same paths to all others."""
    _, _, travel = made(town, 1)
    one, other = travel.row["s1"], travel.row["s3"]
    assert travel.energy_kwh[one, other] == travel.duration_s[one, other] == 0.0
    leg = travel.leg("s1", "s3")
    assert leg is not None
    assert (leg.path, leg.cost_kwh, leg.drive.duration_s) == ((), 0.0, 0.0)
    there, again = travel.leg("s0", "s1"), travel.leg("s0", "s3")
    assert there is not None
    assert again is not None
    assert (there.path, there.end, again.end) == (again.path, "s1", "s3")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_durations_are_safe_and_close_in_a_city(seed: int) -> None:
    """No path takes longer than the matrix says, and none is overestimated by a second."""
    city = small_city(seed)
    travel = Travel(city.problem, roads_of(city.problem, city.snapshot))
    excess = []
    for start, end in product(travel.places, repeat=2):
        leg = travel.leg(start, end)
        assert leg is not None
        duration = travel.duration_s[travel.row[start], travel.row[end]]
        excess.append(duration - leg.drive.duration_s)
    assert min(excess) > -1e-9
    assert max(excess) < 1.0


def test_discounts_change_ways_and_keep_their_energies_honest(town: Town) -> None:
    """Cheap roads attract: other paths, whose energies are their own, never below the least."""
    problem, roads, plain = made(town, 2)
    on = np.array([name.split("-")[0][0] == name.split("-")[1][0] == "1" for name in roads.ids])
    lured = Travel(problem, roads, np.where(on, 0.6 * roads.cost_kwh, 0.0))
    changed = 0
    for start, end in product(plain.places, repeat=2):
        pair = plain.row[start], plain.row[end]
        before, after = plain.leg(start, end), lured.leg(start, end)
        if before is None or after is None:
            assert before is after
            continue
        changed += before.path != after.path
        assert lured.energy_kwh[pair] == pytest.approx(after.cost_kwh)
        assert lured.energy_kwh[pair] >= plain.energy_kwh[pair] - 1e-12
        rows = [roads.index[s] for s in after.path]
        searched = roads.cost_kwh[rows] * np.where(on[rows], 0.4, 1.0)
        assert lured.search_cost_kwh[pair] == pytest.approx(searched.sum())
        assert lured.search_cost_kwh[pair] <= plain.search_cost_kwh[pair] + 1e-12
    assert changed > 0
