from __future__ import annotations

from collections.abc import Callable, Sequence

import networkx as nx
import numpy as np
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.improvement.departures import MAX_WAIT_S, longest_wait_s
from dispatcher_daemon.planning.improvement.partition import blocks_of, opportunity_graph
from dispatcher_daemon.planning.roads.arrays import roads_of
from dispatcher_daemon.planning.roads.travel import Travel
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot

Town = Callable[..., tuple[RoutingProblem, TrafficSnapshot]]


def graph_of(
    town: Town, stops: Sequence[str], vehicles: Sequence[dict[str, float]]
) -> tuple[nx.Graph, Planner, list[Itinerary]]:
    """The opportunities of vans with a stop each; "" leaves one idle."""
    problem, snapshot = town([node or "33" for node in stops], vehicles)
    planner = Planner(problem, snapshot, [Travel(problem, roads_of(problem, snapshot))], 3.0)
    present = []
    for n, node in enumerate(stops):
        visits = (f"s{n}",) if node else ()
        itinerary = planner.itinerary(n, visits, planner.legs(n, visits))
        assert itinerary is not None
        present.append(itinerary)
    windows = [planner.windows.of(n) for n in range(len(present))]
    waits = [longest_wait_s(planner, itinerary) for itinerary in present]
    return opportunity_graph(present, windows, waits, planner.book.shares, 3.0), planner, present


def test_an_edge_weighs_what_two_vans_could_save(town: Town) -> None:
    """Same way, windows that overlap: a leader's and a follower's share on every segment."""
    windows = [{"depart_by_s": 60.0}, {"ready_s": 62.0, "depart_by_s": 90.0}]
    graph, planner, (first, second) = graph_of(town, ["33", "33"], windows)
    shared = set(first.traversals) & set(second.traversals)
    shares = [planner.book.shares[s] for s in shared]
    assert len(shared) == len(first.traversals)
    assert graph.edges[0, 1]["weight"] == pytest.approx(
        sum(s.leader_kwh + s.follower_kwh for s in shares)
    )


def test_vans_that_cannot_be_there_together_have_no_edge(town: Town) -> None:
    """Windows further apart than the window of synchronisation, ways apart, or staying idle."""
    windows = [{"depart_by_s": 60.0}, {"ready_s": 60.0 + MAX_WAIT_S + 3.1}, {}, {}]
    graph, _, present = graph_of(town, ["33", "33", "01", ""], windows)
    assert not set(present[0].traversals) & set(present[2].traversals)
    assert set(graph) == {0, 1, 2}
    assert list(graph.edges) == []


def test_a_wait_at_a_stop_brings_vans_together_on_the_way_home(town: Town) -> None:
    """The edge weighs what the way home saves; the way out they cannot have in common."""
    graph, planner, present = graph_of(town, ["33", "33"], [{}, {"ready_s": 63.1}])
    assert present[0].route is not None
    home = present[0].route.legs[1].path
    saved = sum(
        planner.book.shares[s].leader_kwh + planner.book.shares[s].follower_kwh for s in home
    )
    assert graph.edges[0, 1]["weight"] == pytest.approx(saved)


@pytest.mark.parametrize("most", [2, 5])
def test_blocks_are_small_apart_and_leave_nobody_with_a_partner_out(most: int) -> None:
    """Every vehicle that could platoon is in exactly one block, none is larger than allowed, the
    same seed gives the same blocks, and another one cuts elsewhere.
    """
    rng = np.random.default_rng(7)
    graph = nx.Graph()
    graph.add_nodes_from(range(60))
    for a, b in rng.integers(0, 50, (160, 2)).tolist():
        if a != b:
            graph.add_edge(a, b, weight=float(rng.uniform(0.01, 1.0)))
    blocks = blocks_of(graph, most, 3)
    members = [n for block in blocks for n in block]
    assert sorted(members) == sorted(n for n in graph if graph.degree(n))
    assert len(members) < len(graph)
    assert max(map(len, blocks)) == most
    assert blocks_of(graph, most, 3) == blocks
    assert any(blocks_of(graph, most, seed) != blocks for seed in (4, 5, 6))


def test_blocks_keep_together_what_belongs_together() -> None:
    """Five groups tied closely and to each other loosely come out as the five blocks."""
    graph = nx.Graph()
    groups = [list(range(5 * g, 5 * g + 5)) for g in range(5)]
    for g, group in enumerate(groups):
        graph.add_weighted_edges_from((a, b, 1.0) for a in group for b in group if a < b)
        graph.add_edge(group[0], groups[g - 1][1], weight=0.05)
    assert blocks_of(graph, 5, 1) == groups
    assert blocks_of(nx.Graph(), 5, 1) == []
