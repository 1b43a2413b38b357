from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from dispatcher_daemon.forms.problem import RoutingProblem
from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream_lab.research.resources.scaling import least_cost_paths


def cheapest_by_relaxation(
    network: RoadNetwork, cost: dict[str, float], source: str, target: str
) -> float:
    """Bellman–Ford over segments: slow and plain."""
    best = {s.id: cost[s.id] for s in network.leaving[source]}
    for _ in network.segments:
        for a in list(best):
            for b in network.turns(a):
                best[b] = min(best.get(b, float("inf")), best[a] + cost[b])
    ends = [best[s.id] for s in network.segments.values() if s.end == target and s.id in best]
    return min(ends, default=float("inf"))


@settings(max_examples=25)
@given(values=st.lists(st.floats(0.01, 10.0), min_size=22, max_size=22))
def test_paths_are_connected_legal_and_cheapest(demo: RoutingProblem, values: list[float]) -> None:
    """For any costs, every path obeys the turns and costs what plain relaxation finds."""
    network = demo.network
    cost = dict(zip(sorted(network.segments), values, strict=True))
    nodes = ["depot", "c1", "c2", "c4"]
    paths = least_cost_paths(network, cost, nodes, nodes)
    assert len(paths) == 12
    for (source, target), path in paths.items():
        assert network.segments[path[0]].start == source
        assert network.segments[path[-1]].end == target
        assert all(b in network.follows[a] for a, b in pairwise(path))
        found = sum(cost[name] for name in path)
        assert abs(found - cheapest_by_relaxation(network, cost, source, target)) < 1e-9


def test_forbidden_turn_is_not_taken_but_a_stop_allows_it() -> None:
    """A junction that allows no turn from a into b ends the way, unless one stops there."""
    segments = [
        Segment("a", "x", "y", 100.0, 10.0, 1, ((0, 0), (1, 0))),
        Segment("b", "y", "z", 100.0, 10.0, 1, ((1, 0), (2, 0))),
    ]
    network = build_network(
        "no turn", segments, {"x": (0, 0), "y": (1, 0), "z": (2, 0)}, {"a": (), "b": ()}
    )
    cost = {"a": 1.0, "b": 1.0}
    assert ("x", "z") not in least_cost_paths(network, cost, ["x"], ["z"])
    assert least_cost_paths(network, cost, ["y"], ["z"]) == {("y", "z"): ("b",)}
