"""From a fleet to blocks of vehicles that a small solver can take (networkx communities)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import networkx as nx
import numpy as np
from scipy.sparse import csr_array

from dispatcher_daemon.planning.platooning import Shares
from dispatcher_daemon.planning.routes.itineraries import Itinerary

_MAX_PARTNERS = 24
"""Maximum number of edges of a vehicle; the heaviest are kept."""


def opportunity_graph(
    itineraries: Sequence[Itinerary],
    windows_s: Sequence[tuple[float, float]],
    waits_s: Sequence[float],
    shares: Mapping[str, Shares],
    sync_window_s: float,
) -> nx.Graph:
    """Graph of the vehicles that could platoon, weighted by their saving, kWh.

    An edge's weight is what a pair would save on all open segments that both pass and on which
    departures within their windows, and waits on their tours, can bring them together.

    Args:
        windows_s: first and last departure by vehicle number.
        waits_s: longest wait behind its first stop, likewise.
    """
    graph = nx.Graph()
    driving = [i for i in itineraries if i.traversals]
    graph.add_nodes_from(i.number for i in itineraries if i.route is not None)
    if not driving:
        return graph
    column = {name: n for n, name in enumerate(sorted({s for i in driving for s in i.traversals}))}
    row_of = np.array([r for r, i in enumerate(driving) for _ in i.traversals])
    column_of = np.array([column[s] for i in driving for s in i.traversals])
    saving_kwh = np.array(
        [
            (shares[s].leader_kwh + shares[s].follower_kwh) * shares[s].gate.chance(p[0][0])
            for i in driving
            for s, p in i.traversals.items()
        ]
    )
    # Earliest and latest entry of each vehicle into each segment, as departures and waits shift it.
    entry = np.array([p[0][0] - i.depart_s for i in driving for p in i.traversals.values()])
    behind = np.array([i.route.legs[0].drive.duration_s if i.route else 0.0 for i in driving])
    window = np.array([windows_s[i.number] for i in driving])
    waits = np.array([waits_s[i.number] for i in driving])
    early, late = entry + window[row_of, 0], entry + window[row_of, 1]
    late += np.where(entry >= behind[row_of], waits[row_of], 0.0)
    order = np.lexsort((early, column_of))
    row_of, column_of, early, late, saving_kwh = (
        a[order] for a in (row_of, column_of, early, late, saving_kwh)
    )
    # Partners of a passage: those after it on its segment that can enter before its last moment.
    # One array for all segments: each lies in a span of its own.
    span = float(late.max() - early.min()) + 2 * sync_window_s + 1.0
    begin = np.arange(len(order)) + 1
    end = np.searchsorted(
        early + span * column_of, late + sync_window_s + span * column_of, "right"
    )
    count = end - begin
    first = np.repeat(np.arange(len(order)), count)
    second = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count) + begin[first]
    shape = (len(driving), len(driving))
    summed = csr_array((saving_kwh[first], (row_of[first], row_of[second])), shape=shape)
    summed = (summed + summed.T).tocsr()
    for a in range(len(driving)):
        values = summed.data[summed.indptr[a] : summed.indptr[a + 1]]
        others = summed.indices[summed.indptr[a] : summed.indptr[a + 1]]
        for i in np.argsort(-values, kind="stable")[:_MAX_PARTNERS]:
            if others[i] != a:
                weight = float(values[i])
                graph.add_edge(driving[a].number, driving[others[i]].number, weight=weight)
    return graph


def blocks_of(graph: nx.Graph, max_vehicles: int, seed: int) -> list[list[int]]:
    """Blocks of at most ``max_vehicles`` vehicles with large savings between them.

    Louvain communities (Blondel et al., 2008) on the graph; those that are too large are cut
    greedily: each block grows by the vehicle with the largest weight to it. Vehicles without a
    partner are left out.
    """
    connected = graph.subgraph(n for n, degree in graph.degree() if degree)
    blocks: list[list[int]] = []
    for community in nx.community.louvain_communities(connected, weight="weight", seed=seed):
        blocks += _cut(connected.subgraph(community), max_vehicles, seed)
    return sorted(blocks)


def _cut(community: nx.Graph, max_vehicles: int, seed: int) -> list[list[int]]:
    rng = np.random.default_rng(seed)
    left = sorted(community)
    rank = dict(zip(left, rng.permutation(len(left)), strict=True))
    waiting, blocks = set(left), []
    while waiting:
        block = [min(waiting, key=rank.__getitem__)]
        waiting.discard(block[0])
        tie: dict[int, float] = {}
        while len(block) < max_vehicles and waiting:
            for neighbour, data in community[block[-1]].items():
                if neighbour in waiting:
                    tie[neighbour] = tie.get(neighbour, 0.0) + data["weight"]
            candidates = [n for n in tie if n in waiting]
            if not candidates:
                break
            best = max(candidates, key=lambda n: (tie[n], -rank[n]))
            block.append(best)
            waiting.discard(best)
        blocks.append(sorted(block))
    return blocks
