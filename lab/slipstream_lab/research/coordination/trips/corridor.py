"""The law of freight on a scenario's roads: made for the project's corridor, and fixed before
anything was measured with it.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.research.coordination.trips.drawing import (
    Array,
    draw_pairs,
    drawn_freight,
)
from slipstream_lab.research.coordination.trips.freight import Freight
from slipstream_lab.research.coordination.trips.roads import fastest_ways, freight_segments
from slipstream_lab.simulation.scenarios.demand import (
    FleetSettings,
    Zone,
    departures,
    draw_deliveries,
    zone_weights,
)
from slipstream_lab.simulation.scenarios.scenario import Scenario, load_scenario

DENSITIES: Final = (20, 50, 100, 200, 500, 1000, 2000)
"""Vehicles a day."""
WINDOWS_MIN: Final = (1, 5, 10, 30)
"""Half of the interval in which a trip may arrive, minutes."""
Carriers = Literal["one", "ten"]

_STREAM: Final = {"one": 4001, "ten": 4002}
_PLACES: Final = 4004
_LOADING_S: Final = 1800.0
"""Time in which the vehicles of a wave get ready, one by one."""
_CARRIERS: Final = 10
_MOST_PLACES: Final = 200
"""Of more the seed draws so many, by their weights: ways between all pairs are searched."""


def corridor_freight(
    vehicles: int, window_min: float, carriers: Carriers, seed: int = 1
) -> Freight:
    """A day's trips on the corridor; see `scenario_freight`."""
    return scenario_freight(load_scenario("corridor"), vehicles, window_min, carriers, seed)


def scenario_freight(
    scenario: Scenario, vehicles: int, window_min: float, carriers: Carriers, seed: int = 1
) -> Freight:
    """A day's trips in a scenario; same arguments, same trips.

    Origins, destinations and times are the same for all windows. One carrier: the scenario's
    deliveries, in waves from or to its first depot. Ten: between the places of the largest flow of
    the scenario's demand, round the clock by the hours of its deliveries.

    Raises:
        InputError: no way between two of the places leads over a segment that is watched.
    """
    network = scenario.network
    watched = {stretch.segment for rsu in scenario.rsus or () for stretch in rsu.watch}
    entered = {
        after
        for before in network.segments
        if before not in watched
        for after in network.turns(before)
    }
    # Vehicles wait beside the on-ramps: where others come onto the motorway.
    segments = freight_segments(network, RoutingProfile(), watched, watched & entered)
    rng = np.random.default_rng([seed, _STREAM[carriers], vehicles])
    fleet = draw_deliveries(scenario.fleet, network, seed).settings
    depot = fleet.depots[0].node
    places = _places(scenario, fleet, depot, carriers, seed)
    ways = {
        pair: way
        for pair, way in fastest_ways(network, segments, places).items()
        if not watched.isdisjoint(way)
    }
    if carriers == "one":
        towns = {t: w for t, w in places.items() if (depot, t) in ways and (t, depot) in ways}
        _check(towns, scenario, f"the depot {depot!r} and a customer")
        pairs, preferred_s = _waves(fleet, depot, towns, vehicles, rng)
        owners = ["carrier-1"] * vehicles
    else:
        _check(ways, scenario, "two places of the demand")
        pairs = draw_pairs(ways, places, vehicles, rng)
        preferred_s = departures(scenario.fleet.hours, rng.random(vehicles))
        owners = [f"carrier-{k + 1}" for k in rng.integers(_CARRIERS, size=vehicles)]
    name = f"{scenario.name}-{vehicles}-{window_min:g}-{carriers}-{seed}"
    return drawn_freight(name, segments, [ways[p] for p in pairs], preferred_s, window_min, owners)


def _check(ways: object, scenario: Scenario, between: str) -> None:
    if not ways:
        problem = f"no way between {between} leads over a segment that an RSU watches"
        raise InputError(scenario.name, problem, "give other RSUs", key="--rsus")


def _places(
    scenario: Scenario, fleet: FleetSettings, depot: str, carriers: Carriers, seed: int
) -> dict[str, float]:
    """Places with their weights."""
    network, demand = scenario.network, scenario.demand
    rng = np.random.default_rng([seed, _PLACES])
    if carriers == "one":
        towns = _weights(fleet.stops, network)
        towns.pop(depot, None)
        return {depot: 0.0, **_some(towns, rng)}
    flow = max(demand.flows, key=lambda flow: flow.trips)
    zones = (demand.zones[name] for name in (flow.origin, flow.destination))
    origins, destinations = (_weights(zone, network) for zone in zones)
    return _some({**origins, **destinations}, rng)


def _weights(zone: Zone, network: RoadNetwork) -> dict[str, float]:
    """Weights of a zone's junctions, those that it names first."""
    junctions = tuple(network.junctions)
    weights = dict(zip(junctions, zone_weights(zone, network, junctions).tolist(), strict=True))
    return {name: weights[name] for name in {**zone.junctions, **weights} if weights[name] > 0}


def _some(weights: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    if len(weights) <= _MOST_PLACES:
        return weights
    names, shares = list(weights), np.array(list(weights.values()))
    drawn = rng.choice(len(names), _MOST_PLACES, replace=False, p=shares / shares.sum())
    return {names[k]: weights[names[k]] for k in sorted(drawn.tolist())}


def _waves(
    fleet: FleetSettings,
    depot: str,
    weights: dict[str, float],
    vehicles: int,
    rng: np.random.Generator,
) -> tuple[list[tuple[str, str]], Array]:
    """Half of the vehicles, by chance, leave the depot; the others come back to it."""
    towns, shares = list(weights), np.array(list(weights.values()))
    drawn = rng.choice(len(towns), size=vehicles, p=shares / shares.sum())
    outbound = rng.random(vehicles) < 0.5
    pairs = [
        (depot, towns[k]) if out else (towns[k], depot)
        for k, out in zip(drawn, outbound, strict=True)
    ]
    ordered_s = np.minimum(departures(fleet.hours, rng.random(vehicles)), fleet.last_release_s)
    wave_s = np.minimum(np.ceil(ordered_s / fleet.wave_s) * fleet.wave_s, fleet.last_release_s)
    return pairs, wave_s + rng.uniform(0.0, _LOADING_S, vehicles)
