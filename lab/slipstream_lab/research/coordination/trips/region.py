"""The law of freight in a region of 400 km of motorway. Fixed before anything was measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from slipstream.roads import RoadNetwork, Segment, build_network
from slipstream.vehicle_types import PRESETS
from slipstream_lab.research.coordination.trips.drawing import draw_pairs, drawn_freight
from slipstream_lab.research.coordination.trips.freight import Freight
from slipstream_lab.research.coordination.trips.roads import fastest_ways, freight_segments
from slipstream_lab.simulation.scenarios.demand import FleetSettings, departures

TRUCKS: Final = 5000

_STREAM: Final = 4003
_CARRIERS: Final = 10
_SPACING_KM: Final = 10
_LENGTH_KM: Final = 100
_CROSSINGS_KM: Final = (30, 70)
"""Where the two motorways of each direction lie, and so where they cross the others."""
_LIMIT_MPS: Final = 36.1
_END_WEIGHT: Final = 4.0
_CROSSING_WEIGHT: Final = 3.0
_SHORTEST_M: Final = 20_000.0


def region_freight(window_min: float, trucks: int = TRUCKS, seed: int = 1) -> Freight:
    """A day's trips of 40 t trucks of ten carriers; same arguments, same trips.

    Two motorways of 100 km from west to east and two from south to north, 40 km apart, cross at
    four interchanges. Trucks come and go, and may wait, at places every 10 km. Places draw trips
    by their weight: the motorways' ends 4, interchanges 3, others 1; trips are 20 km or longer.
    """
    network = region_network()
    profile = PRESETS["truck_40t"].profile
    segments = freight_segments(network, profile, network.segments, network.segments)
    weights = {name: _weight(x, y) for name, (x, y) in network.junctions.items()}
    ways = {
        pair: way
        for pair, way in fastest_ways(network, segments, sorted(weights)).items()
        if sum(segments[part].length_m for part in way) >= _SHORTEST_M
    }
    rng = np.random.default_rng([seed, _STREAM, trucks])
    pairs = draw_pairs(ways, weights, trucks, rng)
    preferred_s = departures(FleetSettings().hours, rng.random(trucks))
    owners = [f"carrier-{k + 1}" for k in rng.integers(_CARRIERS, size=trucks)]
    name = f"region-{trucks}-{window_min:g}-ten-{seed}"
    return drawn_freight(name, segments, [ways[p] for p in pairs], preferred_s, window_min, owners)


def region_network() -> RoadNetwork:
    """The region's motorways: both directions between neighbouring places."""
    ends = [(a, b) for pair in _neighbours() for a, b in (pair, pair[::-1])]
    places = {place for pair in ends for place in pair}
    return build_network(
        "region",
        [
            Segment(
                f"{_name(a)}-{_name(b)}",
                _name(a),
                _name(b),
                1000.0 * _SPACING_KM,
                _LIMIT_MPS,
                2,
                ((1000.0 * a[0], 1000.0 * a[1]), (1000.0 * b[0], 1000.0 * b[1])),
            )
            for a, b in ends
        ],
        {_name(place): (1000.0 * place[0], 1000.0 * place[1]) for place in sorted(places)},
    )


_Place = tuple[int, int]
"""East and north, km."""


def _neighbours() -> Iterator[tuple[_Place, _Place]]:
    steps = range(0, _LENGTH_KM, _SPACING_KM)
    for across in _CROSSINGS_KM:
        for along in steps:
            yield (along, across), (along + _SPACING_KM, across)
            yield (across, along), (across, along + _SPACING_KM)


def _name(place: _Place) -> str:
    return f"x{place[0]}y{place[1]}"


def _weight(x_m: float, y_m: float) -> float:
    km = (round(x_m / 1000), round(y_m / 1000))
    if any(part in (0, _LENGTH_KM) for part in km):
        return _END_WEIGHT
    return _CROSSING_WEIGHT if all(part in _CROSSINGS_KM for part in km) else 1.0
