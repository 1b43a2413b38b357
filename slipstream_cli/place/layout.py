"""Where on a network the first depot, stops and camera go. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.snapping import Snapper, stopping_junctions
from slipstream.vehicle_types import RoutingProfile

_STOPS: Final = 4
_VIEW_M: Final = 80.0
"""A camera sees so far along its road."""
_MAX_AWAY_M: Final = 1000.0
"""From a depot's place to its road: beyond it the place is in another town."""


@dataclass(frozen=True)
class Layout:
    """Places of a first fleet and camera.

    Attributes:
        depot: junction.
        away_m: of the depot from the place that was asked for; None: none was.
        stops: junctions, the nearest to the depot first.
        watched: the camera's segment.
        lanes: of that segment.
        view_m: length of road that the camera watches.
    """

    depot: str
    away_m: float | None
    stops: tuple[str, ...]
    watched: str
    lanes: int
    view_m: float


def lay_out(network: RoadNetwork, at_m: tuple[float, float] | None) -> Layout:
    """Choose the places.

    Args:
        network: connected; see `slipstream.osm.largest_part`.
        at_m: the depot is where an address there is served; None: the most central junction, with
            the smallest mean distance to all others.

    Raises:
        InputError: no road where vehicles may stop is within a kilometre.
    """
    ends = stopping_junctions(network)
    away_m = None
    if at_m is None:
        depot = _most_central(network, ends)
    else:
        found = Snapper(network, [RoutingProfile()]).nearest(at_m)
        if found is None:
            problem = "all its roads are expressways, ramps or tunnels"
            raise InputError("--at", problem, "leave it out, and name the depot's node yourself")
        if found.distance_m > _MAX_AWAY_M:
            problem = f"the nearest road for a depot is {found.distance_m / 1000:.1f} km away"
            raise InputError("--at", problem, "give a place of the net: slipstream net show")
        depot, away_m = found.node, found.to_node_m
    place = network.junctions[depot]
    others = sorted(
        (name for name in ends if name != depot),
        key=lambda name: (math.dist(network.junctions[name], place), name),
    )
    # Evenly by rank of distance: near, halfway, far.
    count = min(_STOPS, len(others))
    stops = tuple(others[(2 * k + 1) * len(others) // (2 * count)] for k in range(count))
    watched = min(
        network.segments.values(),
        key=lambda s: (
            s.length_m < _VIEW_M,
            -s.lanes,
            math.dist(network.junctions[s.end], place),
            s.id,
        ),
    )
    return Layout(
        depot, away_m, stops, watched.id, watched.lanes, min(60.0, 0.8 * watched.length_m)
    )


def _most_central(network: RoadNetwork, names: Sequence[str]) -> str:
    """The junction nearest to the geometric median, by Weiszfeld's iteration."""
    places = [network.junctions[name] for name in names]
    x = sum(p[0] for p in places) / len(places)
    y = sum(p[1] for p in places) / len(places)
    for _ in range(20):
        weights = [1.0 / max(math.dist(p, (x, y)), 1.0) for p in places]
        total = sum(weights)
        x = sum(w * p[0] for w, p in zip(weights, places, strict=True)) / total
        y = sum(w * p[1] for w, p in zip(weights, places, strict=True)) / total
    return min(names, key=lambda name: (math.dist(network.junctions[name], (x, y)), name))
