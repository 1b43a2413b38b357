"""Size of a day's deliveries: distance and time of least-energy tours on empty roads.

Without platooning: it shows whether a fleet has the wanted size before any saving is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.roads import Travel, roads_of
from dispatcher_daemon.planning.routes import base_routes
from dispatcher_daemon.settings import SearchSettings
from dispatcher_daemon.traffic import take_snapshot
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.scenarios.demand import DAY_S, Deliveries, fleet_at


@dataclass(frozen=True)
class FleetSize:
    """What a day of deliveries comes to."""

    orders: int
    served: int
    rounds: int
    distance_km: float
    time_h: float
    departures: tuple[int, ...]


def fleet_size(deliveries: Deliveries, network: RoadNetwork) -> FleetSize:
    """Dispatch a day cycle by cycle: every vehicle leaves at once, and drives at the limit."""
    settings = SearchSettings(rounds=1)
    back_s = dict.fromkeys(deliveries.vehicles, 0.0)
    taken: set[str] = set()
    departures: list[int] = []
    distance_m = time_s = now_s = 0.0
    with ThreadPoolExecutor(max_workers=1) as executor:
        while now_s < DAY_S:
            idle = {name: now_s for name, at in back_s.items() if at <= now_s}
            fleet = fleet_at(deliveries, now_s, idle, taken)
            if fleet is not None:
                problem = RoutingProblem(network, fleet)
                roads = roads_of(problem, take_snapshot(network, (), 0, stale_after_s=1.0))
                travel = Travel(problem, roads)
                stops = tuple(stop.id for stop in fleet.stops)
                routes = base_routes(problem, travel, stops, settings, executor, 1).stops
                driven = {name: own for name, own in routes.items() if own}
                for name, own in driven.items():
                    metres, seconds = _round(deliveries.vehicles[name], tuple(own), travel, network)
                    seconds += sum(fleet.service_s(stop) for stop in own)
                    distance_m, time_s = distance_m + metres, time_s + seconds
                    back_s[name] = now_s + seconds
                    taken.update(own)
                departures += [len(driven)] if driven else []
            now_s += deliveries.settings.cycle_s
    return FleetSize(
        len(deliveries.orders),
        len(taken),
        sum(departures),
        distance_m / 1000,
        time_s / 3600,
        tuple(departures),
    )


def _round(
    depot: str, stops: tuple[str, ...], travel: Travel, network: RoadNetwork
) -> tuple[float, float]:
    """Distance, m, and driving time, s, from a depot over stops and back."""
    lengths: Mapping[str, float] = {n: s.length_m for n, s in network.segments.items()}
    metres = seconds = 0.0
    for start, end in pairwise((depot, *stops, depot)):
        leg = travel.leg(start, end)
        assert leg is not None  # the net is in one piece
        metres += sum(lengths[segment] for segment in leg.path)
        seconds += float(travel.duration_s[travel.row[start], travel.row[end]])
    return metres, seconds
