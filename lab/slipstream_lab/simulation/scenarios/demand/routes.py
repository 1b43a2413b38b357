"""Routes of a day's trips: shortest times on roads that fill up, batch by batch."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork, Segment
from slipstream_lab.simulation.scenarios.demand.trips import Array, Indices, Trips

_SIGNAL_S: Final = 9.0
"""Mean wait at signals on an empty road."""
_TURN_S: Final = 2.0
_LANE_PER_H: Final = 1800.0
_GREEN: Final = 0.45
_PRIORITY: Final = 0.65
_BPR: Final = (0.6, 4.0)
"""The Bureau of Public Roads' α and β, t = t₀ (1 + α (volume / capacity)^β); α for city streets."""
_BATCHES: Final = 4
"""Parts of an hour's trips that are sent one after the other, each on the times that the earlier
ones leave."""
_HOUR_S: Final = 3600.0


@dataclass(frozen=True)
class Routes:
    """Routes of trips. `of_trip`: index of each trip's route, shape (n,)."""

    segments: tuple[str, ...]
    ways: tuple[tuple[int, ...], ...]
    of_trip: Indices

    def names(self, trip: int) -> tuple[str, ...]:
        """Ids of the segments of one trip."""
        return tuple(self.segments[i] for i in self.ways[self.of_trip[trip]])

    def passages(self) -> dict[str, int]:
        """How many trips drive over each segment that any does."""
        used = Counter(self.of_trip.tolist())
        total: Counter[int] = Counter()
        for way, count in used.items():
            total.update(dict.fromkeys(self.ways[way], count))
        return {self.segments[i]: total[i] for i in sorted(total)}


def capacity_per_h(segment: Segment, network: RoadNetwork) -> float:
    """Vehicles an hour that a segment lets through, by its lanes and what stands at its end."""
    share = _GREEN if segment.end in network.signals else _PRIORITY
    motorway = segment.speed_limit_mps > 22.0 and segment.end not in network.signals
    return segment.lanes * _LANE_PER_H * (1.0 if motorway else share)


def find_routes(trips: Trips, network: RoadNetwork, seed: int) -> Routes:
    """A route for each trip; same arguments, same routes.

    Trips of an hour are assigned to batches by the seed; each batch takes the shortest paths on the
    times that the earlier batches of the hour leave behind.

    Raises:
        InputError: there is no path between two places.
    """
    roads = _Roads(network, trips.junctions)
    rng = np.random.default_rng([seed, 1000])
    batch = rng.integers(_BATCHES, size=len(trips))
    hour = (trips.depart_s // _HOUR_S).astype(np.int64)
    known: dict[tuple[int, ...], int] = {}
    of_trip = np.zeros(len(trips), dtype=np.int64)
    for h in range(24):
        volume = np.zeros(len(roads.segments))
        for b in range(_BATCHES):
            chosen = np.flatnonzero((hour == h) & (batch == b))
            if not len(chosen):
                continue
            origins = np.unique(trips.origin[chosen])
            before = roads.search(volume * (_BATCHES / max(b, 1)), origins)
            rows = {int(origin): row for row, origin in enumerate(origins)}
            ways: dict[tuple[int, int], tuple[int, ...]] = {}
            for trip in chosen.tolist():
                pair = int(trips.origin[trip]), int(trips.destination[trip])
                if pair not in ways:
                    ways[pair] = roads.way(before[rows[pair[0]]], *pair)
                way = ways[pair]
                of_trip[trip] = known.setdefault(way, len(known))
                volume[list(way)] += 1.0
    return Routes(roads.segments, tuple(known), of_trip)


class _Roads:
    """A graph whose vertices are segments, then junctions as origins, then as destinations."""

    def __init__(self, network: RoadNetwork, junctions: tuple[str, ...]) -> None:
        self.segments = tuple(network.segments)
        self._junctions = junctions
        index = {name: i for i, name in enumerate(self.segments)}
        place = {name: i for i, name in enumerate(junctions)}
        count, places = len(self.segments), len(junctions)
        segments = [network.segments[name] for name in self.segments]
        self._free_s = np.array(
            [s.free_flow_s + (_SIGNAL_S if s.end in network.signals else _TURN_S) for s in segments]
        )
        self._capacity = np.array([capacity_per_h(s, network) for s in segments])
        arcs = [(index[a], index[b]) for a in self.segments for b in network.follows.get(a, ())]
        arcs += [(count + place[s.start], i) for i, s in enumerate(segments)]
        arcs += [(i, count + places + place[s.end]) for i, s in enumerate(segments)]
        self._from, self._onto = np.array(arcs, dtype=np.int64).T
        self._size = count + 2 * places

    def search(self, volume: Array, origins: Indices) -> Indices:
        """Predecessors on the shortest ways from some junctions, shape (origins, vertices)."""
        alpha, beta = _BPR
        times = self._free_s * (1 + alpha * (volume / self._capacity) ** beta)
        # Entering a destination costs 0, which a sparse matrix treats as no edge.
        cost = np.append(times, np.full(self._size - len(times), 1e-6))[self._onto]
        graph = csr_array((cost, (self._from, self._onto)), shape=(self._size, self._size))
        _, before = dijkstra(graph, indices=len(times) + origins, return_predecessors=True)
        return np.asarray(before, dtype=np.int64)

    def way(self, before: Indices, origin: int, destination: int) -> tuple[int, ...]:
        count = len(self.segments)
        way = []
        vertex = int(before[count + len(self._junctions) + destination])
        while 0 <= vertex < count:
            way.append(vertex)
            vertex = int(before[vertex])
        if not way:
            raise InputError(
                "network",
                f"no way from {self._junctions[origin]!r} to {self._junctions[destination]!r}",
                "give a net in one piece",
            )
        return tuple(reversed(way))
