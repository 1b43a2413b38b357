"""The law of freight on the project's corridor. Fixed before anything was measured with it."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from slipstream.vehicle_types import RoutingProfile
from slipstream_lab.research.coordination.trips.drawing import (
    Array,
    Pairs,
    draw_pairs,
    drawn_freight,
)
from slipstream_lab.research.coordination.trips.freight import Freight
from slipstream_lab.research.coordination.trips.roads import fastest_ways, freight_segments
from slipstream_lab.simulation.scenarios.demand import departures
from slipstream_lab.simulation.scenarios.scenario import Scenario, load_scenario

DENSITIES: Final = (20, 50, 100, 200, 500, 1000, 2000)
"""Vehicles a day."""
WINDOWS_MIN: Final = (1, 5, 10, 30)
"""Half of the interval in which a trip may arrive, minutes."""
Carriers = Literal["one", "ten"]

_STREAM: Final = {"one": 4001, "ten": 4002}
_LOADING_S: Final = 1800.0
"""Time in which the vehicles of a wave get ready, one by one."""
_CARRIERS: Final = 10


def corridor_freight(
    vehicles: int, window_min: float, carriers: Carriers, seed: int = 1
) -> Freight:
    """A day's trips on the corridor; same arguments, same trips.

    Origins, destinations and times are the same for all windows. One carrier: the scenario's
    deliveries, in waves from or to its depot. Ten: between all places of the scenario's demand,
    round the clock by the hours of its deliveries.
    """
    scenario = load_scenario("corridor")
    network = scenario.network
    assert scenario.rsus is not None
    watched = {stretch.segment for rsu in scenario.rsus for stretch in rsu.watch}
    entered = {
        after
        for before in network.segments
        if before not in watched
        for after in network.turns(before)
    }
    # Vehicles wait beside the on-ramps: where others come onto the motorway.
    segments = freight_segments(network, RoutingProfile(), watched, watched & entered)
    rng = np.random.default_rng([seed, _STREAM[carriers], vehicles])
    places = _places(scenario, carriers)
    ways = {
        pair: way
        for pair, way in fastest_ways(network, segments, places).items()
        if not watched.isdisjoint(way)
    }
    if carriers == "one":
        pairs, preferred_s = _waves(scenario, ways, vehicles, rng)
        owners = ["carrier-1"] * vehicles
    else:
        pairs = draw_pairs(ways, places, vehicles, rng)
        preferred_s = departures(scenario.fleet.hours, rng.random(vehicles))
        owners = [f"carrier-{k + 1}" for k in rng.integers(_CARRIERS, size=vehicles)]
    name = f"corridor-{vehicles}-{window_min:g}-{carriers}-{seed}"
    return drawn_freight(name, segments, [ways[p] for p in pairs], preferred_s, window_min, owners)


def _places(scenario: Scenario, carriers: Carriers) -> dict[str, float]:
    """Places with their weights."""
    if carriers == "one":
        depot = scenario.fleet.depots[0].node
        return {depot: 0.0, **scenario.fleet.stops.junctions}
    zones = scenario.demand.zones
    return {**zones["suburbs"].junctions, **zones["city"].junctions}


def _waves(
    scenario: Scenario, ways: Pairs, vehicles: int, rng: np.random.Generator
) -> tuple[list[tuple[str, str]], Array]:
    """Half of the vehicles, by chance, leave the depot; the others come back to it."""
    fleet = scenario.fleet
    depot = fleet.depots[0].node
    towns = [t for t in fleet.stops.junctions if (depot, t) in ways and (t, depot) in ways]
    weights = np.array([fleet.stops.junctions[town] for town in towns])
    drawn = rng.choice(len(towns), size=vehicles, p=weights / weights.sum())
    outbound = rng.random(vehicles) < 0.5
    pairs = [
        (depot, towns[k]) if out else (towns[k], depot)
        for k, out in zip(drawn, outbound, strict=True)
    ]
    ordered_s = np.minimum(departures(fleet.hours, rng.random(vehicles)), fleet.last_release_s)
    wave_s = np.minimum(np.ceil(ordered_s / fleet.wave_s) * fleet.wave_s, fleet.last_release_s)
    return pairs, wave_s + rng.uniform(0.0, _LOADING_S, vehicles)
