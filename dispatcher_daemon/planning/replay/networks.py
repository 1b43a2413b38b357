"""Road networks as plain data, the same data for the same network."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

import msgspec

from slipstream.roads import Crossing, RoadNetwork, Segment
from slipstream.roads.access import OPEN
from slipstream.roads.projection import Projection


def network_data(network: RoadNetwork) -> dict[str, Any]:
    """A network as data that JSON can hold; sets are sorted, all else keeps its order."""
    return {
        "name": network.name,
        "segments": [_segment_data(segment) for segment in network.segments.values()],
        "junctions": dict(network.junctions),
        "follows": dict(network.follows),
        "signals": sorted(network.signals),
        "crossings": [[a, b, _data(c)] for (a, b), c in network.crossings.items()],
        "turn_classes": [[a, b, sorted(c)] for (a, b), c in network.turn_classes.items()],
        "projection": None if network.projection is None else _data(network.projection),
        "left_hand": network.left_hand,
    }


def network_from(data: dict[str, Any]) -> RoadNetwork:
    """The network of `network_data`.

    Raises:
        ValueError, TypeError, KeyError: it is none.
    """
    segments = [msgspec.convert(row, Segment) for row in data["segments"]]
    crossings = {
        (a, b): msgspec.convert(row, Crossing, str_keys=True) for a, b, row in data["crossings"]
    }
    return RoadNetwork(
        data["name"],
        MappingProxyType({segment.id: segment for segment in segments}),
        MappingProxyType({name: (x, y) for name, (x, y) in data["junctions"].items()}),
        MappingProxyType({name: tuple(onto) for name, onto in data["follows"].items()}),
        frozenset(data["signals"]),
        MappingProxyType(crossings),
        MappingProxyType({(a, b): frozenset(c) for a, b, c in data["turn_classes"]}),
        msgspec.convert(data["projection"], Projection | None),
        data["left_hand"],
    )


def _segment_data(segment: Segment) -> dict[str, Any]:
    row = _data(segment)
    if segment.access == OPEN:
        del row["access"]
    return row


def _data(of: object) -> dict[str, Any]:
    row: dict[str, Any] = msgspec.to_builtins(of, order="deterministic", enc_hook=dict)
    return row
