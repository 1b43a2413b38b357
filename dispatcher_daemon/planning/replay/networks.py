"""Road networks as plain data, the same data for the same network."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

from slipstream.roads import Crossing, RoadNetwork, Segment
from slipstream.roads.access import OPEN, Access
from slipstream.roads.projection import Projection


def network_data(network: RoadNetwork) -> dict[str, Any]:
    """A network as data that JSON can hold; sets are sorted, all else keeps its order."""
    projection = network.projection
    return {
        "name": network.name,
        "segments": [_segment_data(segment) for segment in network.segments.values()],
        "junctions": {name: list(place) for name, place in network.junctions.items()},
        "follows": {name: list(onto) for name, onto in network.follows.items()},
        "signals": sorted(network.signals),
        "crossings": [[a, b, *_crossing_data(c)] for (a, b), c in network.crossings.items()],
        "turn_classes": [[a, b, sorted(c)] for (a, b), c in network.turn_classes.items()],
        "projection": None
        if projection is None
        else [projection.parameter, list(projection.offset_m)],
    }


def network_from(data: dict[str, Any]) -> RoadNetwork:
    """The network of `network_data`.

    Raises:
        ValueError, TypeError, KeyError: it is none.
    """
    segments = [_segment_from(*row) for row in data["segments"]]
    projection = data["projection"]
    return RoadNetwork(
        data["name"],
        MappingProxyType({segment.id: segment for segment in segments}),
        MappingProxyType({name: (x, y) for name, (x, y) in data["junctions"].items()}),
        MappingProxyType({name: tuple(onto) for name, onto in data["follows"].items()}),
        frozenset(data["signals"]),
        MappingProxyType({(a, b): _crossing_from(*row) for a, b, *row in data["crossings"]}),
        MappingProxyType({(a, b): frozenset(c) for a, b, c in data["turn_classes"]}),
        None if projection is None else Projection(projection[0], tuple(projection[1])),
    )


def _segment_data(segment: Segment) -> list[Any]:
    access = segment.access
    limits = [access.max_height_m, access.max_width_m, access.max_length_m, access.max_mass_kg]
    return [
        segment.id,
        segment.start,
        segment.end,
        segment.length_m,
        segment.speed_limit_mps,
        segment.lanes,
        [list(point) for point in segment.shape],
        None
        if access == OPEN
        else [
            None if access.classes is None else sorted(access.classes),
            limits,
            sorted(access.class_speeds_mps.items()),
        ],
    ]


def _segment_from(
    name: str,
    start: str,
    end: str,
    length_m: float,
    speed_limit_mps: float,
    lanes: int,
    shape: list[list[float]],
    access: list[Any] | None,
) -> Segment:
    who = OPEN
    if access is not None:
        classes, (height_m, width_m, longest_m, mass_kg), speeds = access
        admitted = None if classes is None else frozenset(classes)
        who = Access(admitted, height_m, width_m, longest_m, mass_kg, dict(speeds))
    points = tuple((x, y) for x, y in shape)
    return Segment(name, start, end, length_m, speed_limit_mps, lanes, points, who)


def _crossing_data(crossing: Crossing) -> list[Any]:
    groups = sorted(crossing.signal_groups.items())
    where = [crossing.length_m, crossing.speed_mps, crossing.yields, crossing.intersection]
    return [*where, groups]


def _crossing_from(
    length_m: float, speed_mps: float, yields: bool, intersection: str | None, groups: list[Any]
) -> Crossing:
    return Crossing(length_m, speed_mps, yields, intersection, dict(groups))
