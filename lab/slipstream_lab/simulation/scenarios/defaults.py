"""What is made up around a net of the user's, sized for it."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, hypot
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from slipstream.roads import RoadNetwork
from slipstream.roads.access import ALL_CLASSES
from slipstream_lab.simulation.scenarios.demand import (
    DemandSettings,
    FleetSettings,
    Flow,
    Zone,
    gateways,
)
from slipstream_lab.simulation.sumo import TYPES

TRIPS_PER_KM: Final = 170
_TRIPS: Final = (500, 1_000_000)
_SHARES: Final = {"car": 0.9, "van": 0.06, "truck": 0.04}
_ALL_DAY: Final = (
    *(0.5, 0.3, 0.2, 0.2, 0.4, 1.2, 3.0, 6.0, 6.0, 5.0, 5.0, 5.4),
    *(5.8, 5.6, 5.8, 6.6, 7.4, 7.2, 5.8, 4.4, 3.4, 2.6, 1.6, 0.8),
)

KM_PER_RSU: Final = 15.0
"""As in Troy."""
_RSUS: Final = 12
KEEP_S: Final = 300.0
"""As on the corridor: light traffic seldom has three vehicles a minute to judge by."""

_FLEET_KM: Final = 160.0
"""Of road, that a fleet of the usual size delivers on; longer nets have more orders."""
_ORDERS: Final = 10
"""Times the usual number, at most."""
_NEAR_S: Final = 1800.0
"""Where the longest drive takes longer, orders have so much more time, and vehicles are away for
so much longer."""
_SPARE: Final = 1.5
"""Vehicles for each that the busiest hour needs on average."""
_ORIGINS: Final = 50


def road_km(network: RoadNetwork) -> float:
    """Length of all segments."""
    return sum(segment.length_m for segment in network.segments.values()) / 1000


def default_demand(network: RoadNetwork) -> DemandSettings:
    """Light demand for a net of which nothing is known: random pairs of places, a day's curve."""
    ends = dict.fromkeys(sorted(gateways(network)), 1.0)
    least, most = _TRIPS
    trips = min(most, max(least, round(TRIPS_PER_KM * road_km(network))))
    usual = DemandSettings.model_fields["min_trip_m"].default
    return DemandSettings(
        zones={"anywhere": Zone(base=1.0, junctions=ends)},
        flows=(
            Flow(
                name="any",
                trips=trips,
                origin="anywhere",
                destination="anywhere",
                hours=_ALL_DAY,
            ),
        ),
        types={name: share for name, share in _SHARES.items() if _is_open(network, name)},
        # A small net has no two places that far apart.
        min_trip_m=min(usual, round(_extent_m(network) / 2)),
    )


def default_fleet(network: RoadNetwork, usual: FleetSettings) -> FleetSettings:
    """A fleet of the usual kind: with orders by the length of the roads, vehicles for the busiest
    hour's tours, and orders that are due no sooner than vehicles can be there.
    """
    drives_s = _drives_s(network)
    orders = round(usual.orders * min(_ORDERS, max(1.0, road_km(network) / _FLEET_KM)))
    each = usual.capacity / (sum(usual.parcels) / 2)
    # There and back, and between stops half as far.
    tour_s = (2 + (each - 1) / 2) * float(drives_s.mean()) + each * sum(usual.service_s) / 2
    tours = orders * max(usual.hours) / sum(usual.hours) / each
    ends = gateways(network)
    only_ends = Zone(junctions=dict.fromkeys(sorted(ends), 1.0))
    more_s = float(min(36_000.0, 300.0 * ceil(max(0.0, drives_s.max() - _NEAR_S) / 300)))
    return usual.model_copy(
        update={
            "orders": orders,
            # Customers are at no gateway, unless there is nothing else.
            "stops": only_ends if len(ends) == len(network.junctions) else usual.stops,
            "vehicles": min(2000, max(usual.vehicles, ceil(_SPARE * tours * tour_s / 3600))),
            "wave_due_s": _later(usual.wave_due_s, more_s),
            "express_due_s": _later(usual.express_due_s, more_s),
            "last_release_s": usual.last_release_s - more_s,
        }
    )


def rsu_count(network: RoadNetwork) -> int:
    """RSUs of a net for which nobody says where they stand."""
    return max(_RSUS, round(road_km(network) / KM_PER_RSU))


def _later(range_s: tuple[float, float], more_s: float) -> tuple[float, float]:
    return range_s[0] + more_s, range_s[1] + more_s


def _is_open(network: RoadNetwork, kind: str) -> bool:
    """Whether vehicles of a type may use every segment and turn, so that any route is theirs."""
    vclass = TYPES[kind].vclass
    classes = [segment.access.classes or ALL_CLASSES for segment in network.segments.values()]
    return all(vclass in one for one in (*classes, *network.turn_classes.values()))


def _extent_m(network: RoadNetwork) -> float:
    """Diagonal of the rectangle around all junctions."""
    xs, ys = zip(*network.junctions.values(), strict=True)
    return hypot(max(xs) - min(xs), max(ys) - min(ys))


def _drives_s(network: RoadNetwork) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Times of drives on empty roads from some places to all others that they lead to."""
    names: Sequence[str] = tuple(network.junctions)
    index = {name: i for i, name in enumerate(names)}
    quickest: dict[tuple[int, int], float] = {}
    for segment in network.segments.values():
        pair = index[segment.start], index[segment.end]
        quickest[pair] = min(segment.free_flow_s, quickest.get(pair, np.inf))
    start, end = np.array(list(quickest), dtype=np.int64).T
    times = csr_array((list(quickest.values()), (start, end)), shape=(len(names), len(names)))
    origins = np.unique(np.linspace(0, len(names) - 1, _ORIGINS).astype(np.int64))
    found = dijkstra(times, indices=origins)
    return np.asarray(found[np.isfinite(found) & (found > 0)])
