"""The day's trips: how many, when, from where to where; drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork
from slipstream_lab.simulation.scenarios.demand.breakdowns import Breakdown
from slipstream_lab.simulation.sumo import TYPES

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

DAY_S: Final = 86400
_SPEED_FACTORS: Final = (0.8, 1.2)

Weight = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Hours = Annotated[tuple[Weight, ...], Field(min_length=24, max_length=24)]


class Centre(Settings):
    """A place that draws trips from its surroundings, less with distance: w exp(−d² / 2s²)."""

    junction: Identifier
    weight: Weight
    spread_m: Annotated[float, Field(gt=0, le=20_000)]


class Zone(Settings):
    """Where trips begin or end, as a weight a junction: base + centres + single junctions."""

    base: Weight = Field(default=0.0, description="Of each junction that is no gateway.")
    centres: tuple[Centre, ...] = ()
    junctions: dict[Identifier, Weight] = Field(default_factory=dict)


class Flow(Settings):
    """Trips of one purpose."""

    name: Identifier
    trips: Annotated[int, Field(ge=1, le=1_000_000)] = Field(description="A day.")
    origin: Identifier = Field(description="Name of a zone.")
    destination: Identifier = Field(description="Name of a zone.")
    hours: Hours = Field(description="Departures by hour, in relation to each other.")
    decay_length_m: Annotated[float, Field(gt=0)] | None = Field(
        default=None,
        serialization_alias="reach_m",
        description="A trip of length d is drawn with a weight of exp(−d/decay_length_m). "
        "None: the length does not count.",
    )


class DemandSettings(Settings):
    """The demand of a day."""

    zones: dict[Identifier, Zone]
    flows: Annotated[tuple[Flow, ...], Field(min_length=1)]
    types: dict[Identifier, Weight] = Field(description="Share of each vehicle type.")
    speed_factor_std: Annotated[float, Field(ge=0, le=0.3)] = Field(
        default=0.08, description="Of drivers' own speed over the limit; its mean is 1."
    )
    min_trip_m: Annotated[float, Field(ge=0)] = Field(
        default=800.0,
        serialization_alias="shortest_m",
        description="Shortest trip, as the crow flies.",
    )
    breakdowns: tuple[Breakdown, ...] = ()

    def digest_text(self) -> str:
        """JSON for digests, under the former key names: stored arms hold digests of these.

        Without breakdowns that key is left out, as it came later than the first stored arms.
        """
        return self.model_dump_json(
            by_alias=True, exclude=None if self.breakdowns else {"breakdowns"}
        )


@dataclass(frozen=True)
class Trips:
    """Trips in the order of departure; arrays of shape (n,). `place`: how far along its first and
    its last segment it starts and ends, shape (n, 2), in [0.1, 0.9].
    """

    depart_s: Array
    origin: Indices
    destination: Indices
    flow: Indices
    kind: Indices
    speed_factor: Array
    place: Array
    junctions: tuple[str, ...]
    types: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.depart_s)


def draw_trips(
    settings: DemandSettings, network: RoadNetwork, seed: int, source: str | Path = "demand"
) -> Trips:
    """Draw a day's trips; each purpose has a random stream of its own. Raises InputError: a zone,
    a junction or a type that does not exist, or a purpose without a pair of places.
    """
    _check(settings, network, source)
    junctions = tuple(network.junctions)
    where = np.array([network.junctions[name] for name in junctions], dtype=np.float64)
    apart = np.hypot(*(where[:, None, :] - where[None, :, :]).transpose(2, 0, 1))
    weights = {
        name: zone_weights(zone, network, junctions) for name, zone in settings.zones.items()
    }
    types = tuple(settings.types)
    shares = np.array([settings.types[name] for name in types])
    parts = []
    for index, flow in enumerate(settings.flows):
        rng = np.random.default_rng([seed, index])
        pairs = np.outer(weights[flow.origin], weights[flow.destination])
        if flow.decay_length_m is not None:
            pairs = pairs * np.exp(-apart / flow.decay_length_m)
        pairs[apart < settings.min_trip_m] = 0.0
        if pairs.sum() <= 0:
            raise InputError(
                source, "no two places to drive between", "mend its zones", key=flow.name
            )
        drawn = rng.choice(pairs.size, size=flow.trips, p=(pairs / pairs.sum()).ravel())
        low, high = _SPEED_FACTORS
        parts.append(
            (
                np.round(departures(flow.hours, rng.random(flow.trips)), 1),
                drawn // len(junctions),
                drawn % len(junctions),
                np.full(flow.trips, index),
                rng.choice(len(types), size=flow.trips, p=shares / shares.sum()),
                np.clip(rng.normal(1.0, settings.speed_factor_std, flow.trips), low, high),
                rng.uniform(0.1, 0.9, (flow.trips, 2)),
            )
        )
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(columns[0], kind="stable")
    depart_s, origin, destination, purpose, kind, factor, place = (c[order] for c in columns)
    return Trips(depart_s, origin, destination, purpose, kind, factor, place, junctions, types)


def departures(hours: Hours, uniform: Array) -> Array:
    """Times of day for uniform draws in [0, 1); their density is linear between the middles of the
    hours, round the clock.
    """
    middles = np.array([*hours[-1:], *hours, *hours[:1]])
    times = (np.arange(-1, 25) + 0.5) * 3600.0
    grid = np.linspace(0.0, DAY_S, 24 * 60 + 1)
    density = np.interp(grid, times, middles)
    total = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
    drawn = np.interp(uniform * total[-1], total, grid)
    return np.asarray(np.minimum(drawn, DAY_S - 0.1))


def zone_weights(zone: Zone, network: RoadNetwork, junctions: tuple[str, ...]) -> Array:
    """Weight of each junction in a zone, shape (junctions,)."""
    where = np.array([network.junctions[name] for name in junctions], dtype=np.float64)
    inner = np.array([name not in gateways(network) for name in junctions])
    weights = np.where(inner, zone.base, 0.0)
    for centre in zone.centres:
        off = where - np.array(network.junctions[centre.junction])
        near = np.exp(-np.square(off).sum(axis=1) / (2 * centre.spread_m**2))
        weights = weights + np.where(inner, centre.weight * near, 0.0)
    for name, weight in zone.junctions.items():
        weights[junctions.index(name)] += weight
    return weights


def gateways(network: RoadNetwork) -> frozenset[str]:
    """Junctions where the model ends: all their segments lead from and to one neighbour."""
    neighbours: Mapping[str, set[str]] = {name: set() for name in network.junctions}
    for segment in network.segments.values():
        neighbours[segment.start].add(segment.end)
        neighbours[segment.end].add(segment.start)
    return frozenset(name for name, others in neighbours.items() if len(others) == 1)


def _check(settings: DemandSettings, network: RoadNetwork, source: str | Path) -> None:
    for name, zone in settings.zones.items():
        check_zone(f"zones.{name}", zone, network, source)
    for flow in settings.flows:
        for name in (flow.origin, flow.destination):
            if name not in settings.zones:
                raise InputError(source, f"no zone {name!r}", "add it", key=f"flows.{flow.name}")
        if sum(flow.hours) <= 0:
            raise InputError(source, "no hour has a departure", "mend hours", key=flow.name)
    if not settings.types or sum(settings.types.values()) <= 0:
        raise InputError(source, "no vehicle type", "give shares", key="types")
    strange = next((name for name in settings.types if name not in TYPES), None)
    if strange is not None:
        known = ", ".join(TYPES)
        raise InputError(source, f"no vehicle type {strange!r}", f"use {known}", key="types")


def check_zone(key: str, zone: Zone, network: RoadNetwork, source: str | Path) -> None:
    """Check that a zone's places are in the network. Raises InputError: one is not."""
    for junction in (*(centre.junction for centre in zone.centres), *zone.junctions):
        if junction not in network.junctions:
            problem = f"no junction {junction!r} in net {network.name!r}"
            raise InputError(source, problem, "name one of the net", key=key)
