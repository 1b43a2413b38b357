"""Segments for freight from a road network, and the fastest ways over it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import networkx as nx

from dispatcher_daemon.planning.roads import planning_speed_mps
from dispatcher_daemon.traffic import SegmentTraffic
from slipstream.energy.traction import ETA_FOLLOWER, ETA_LEADER, drag_saving_kwh, stop_energy_kwh
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.research.coordination.trips.freight import MS, FreightSegment


def freight_segments(
    network: RoadNetwork,
    profile: RoutingProfile,
    open_segments: Collection[str],
    hubs: Collection[str],
) -> dict[str, FreightSegment]:
    """Segments at the planning speed in free flow."""
    found = {}
    for name, segment in network.segments.items():
        traffic = SegmentTraffic(name, segment.speed_limit_mps)
        speed = planning_speed_mps(segment, traffic, profile)
        physics, length_m = profile.physics, segment.length_m
        found[name] = FreightSegment(
            length_m,
            max(1, round(MS * length_m / speed)),
            drag_saving_kwh(length_m, speed, ETA_FOLLOWER, physics),
            drag_saving_kwh(length_m, speed, ETA_LEADER, physics),
            name in open_segments,
            stop_energy_kwh(speed, physics) if name in hubs else None,
        )
    return found


def fastest_ways(
    network: RoadNetwork, segments: Mapping[str, FreightSegment], places: Iterable[str]
) -> dict[tuple[str, str], tuple[str, ...]]:
    """Segment ids of the fastest way between any two of the places that are connected."""
    graph = nx.DiGraph()
    for name, segment in network.segments.items():
        graph.add_edge(("from", segment.start), name, weight=segments[name].duration_ms)
        graph.add_edge(name, ("to", segment.end), weight=0)
        for after in network.turns(name):
            graph.add_edge(name, after, weight=segments[after].duration_ms)
    ends = list(places)
    ways = {}
    for origin in ends:
        if ("from", origin) not in graph:
            continue
        paths = nx.single_source_dijkstra_path(graph, ("from", origin), weight="weight")
        for destination in ends:
            path = paths.get(("to", destination))
            if path is not None and destination != origin:
                ways[origin, destination] = tuple(path[1:-1])
    return ways
