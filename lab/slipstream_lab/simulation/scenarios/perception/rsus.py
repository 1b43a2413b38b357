"""Where RSUs stand if nobody says: on the busiest approaches."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot

from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.rsus import Rsu, WatchedStretch


def place_rsus(
    network: RoadNetwork,
    passages: Mapping[str, int],
    count: int = 12,
    *,
    min_m: float = 150.0,
    max_m: float = 300.0,
    setback_m: float = 60.0,
    min_spacing_m: float = 600.0,
) -> tuple[Rsu, ...]:
    """RSUs on the busiest approaches that are long enough and not too near each other.

    Args:
        setback_m: between the stretch and the junction: what lies nearer is a queue most of the
            time, whatever the traffic does.
    """
    chosen: list[Rsu] = []
    taken: list[tuple[float, float]] = []
    for name in sorted(passages, key=lambda name: (-passages[name], name)):
        segment = network.segments[name]
        place = network.junctions[segment.end]
        near = any(hypot(place[0] - x, place[1] - y) < min_spacing_m for x, y in taken)
        if len(chosen) == count or segment.length_m < min_m + setback_m or near:
            continue
        end_m = round(segment.length_m - setback_m, 1)
        begin_m = max(0.0, round(end_m - max_m, 1))
        stretch = WatchedStretch(segment=name, from_m=begin_m, to_m=end_m)
        chosen.append(Rsu(id=f"rsu-{len(chosen) + 1:02}", watch=(stretch,)))
        taken.append(place)
    return tuple(chosen)
