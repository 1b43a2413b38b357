"""Where RSUs stand if nobody says: on the busiest approaches."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot
from typing import Final

from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.rsus import Rsu, WatchedStretch

_LEVELS: Final = ((150.0, 60.0, 600.0), (60.0, 20.0, 150.0))
"""Shortest stretch, least way from it to the junction and between RSUs, m: as it should be, as what
is nearer is a queue most of the time; and where blocks are too short for that."""


def place_rsus(
    network: RoadNetwork,
    passages: Mapping[str, int],
    count: int = 12,
    *,
    max_m: float = 300.0,
    keep_s: float = 0.0,
) -> tuple[Rsu, ...]:
    """RSUs on the busiest approaches that are long enough and not too near each other; fewer where
    there are no more. `keep_s`: of each.
    """
    chosen: list[Rsu] = []
    taken: list[tuple[float, float]] = []
    busiest = sorted(passages, key=lambda name: (-passages[name], name))
    for min_m, setback_m, apart_m in _LEVELS:
        for name in busiest:
            segment = network.segments[name]
            place = network.junctions[segment.end]
            near = any(hypot(place[0] - x, place[1] - y) < apart_m for x, y in taken)
            if len(chosen) == count or segment.length_m < min_m + setback_m or near:
                continue
            end_m = round(segment.length_m - setback_m, 1)
            begin_m = max(0.0, round(end_m - max_m, 1))
            stretch = WatchedStretch(segment=name, from_m=begin_m, to_m=end_m)
            chosen.append(Rsu(id=f"rsu-{len(chosen) + 1:02}", watch=(stretch,), keep_s=keep_s))
            taken.append(place)
    return tuple(chosen)
