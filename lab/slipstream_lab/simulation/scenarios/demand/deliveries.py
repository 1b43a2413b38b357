"""Deliveries of a day: depots, vehicles and orders from a seed, and the fleet of one cycle.

What is drawn here is fixed before any saving is measured; it knows nothing of platoons, RSUs or
traffic.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Self

import numpy as np
from pydantic import Field, model_validator

from dispatcher_daemon.fleet import Break, Depot, Fleet, Stop, Vehicle
from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.vehicle_types import PRESETS, PresetName, VehicleType
from slipstream_lab.simulation.scenarios.demand.trips import (
    Array,
    Hours,
    Zone,
    check_zone,
    departures,
    zone_weights,
)

_STREAM: Final = 2000
_PLACES: Final = 2
_DAY_S: Final = 86_400.0
_SHARES: Final = 2400
"""Of the orders, evenly: what is expected of a day's curve."""
_DAY_CURVE: Final = (
    *(0.4, 0.2, 0.2, 0.4, 1.0, 2.4, 4.6, 6.4, 7.2, 7.4, 7.2, 6.8),
    *(6.2, 6.4, 6.6, 6.8, 6.8, 6.4, 5.6, 4.4, 3.2, 2.0, 1.2, 0.6),
)

Seconds = Annotated[float, Field(ge=0, le=86400, allow_inf_nan=False)]
Range = tuple[Seconds, Seconds]


class FleetSettings(Settings):
    """A delivery business over one day."""

    depots: tuple[Depot, ...] = Field(
        default=(), description="Each has every parcel in stock; none: two places by the seed."
    )
    vehicles: Annotated[int, Field(ge=1, le=2000)] = Field(
        default=16, description="Spread evenly over the depots."
    )
    type: PresetName = Field(default="paper_car", description="Of all vehicles: a preset.")
    capacity: Annotated[int, Field(ge=1)] = Field(default=8, description="Parcels a vehicle.")
    orders: Annotated[int, Field(ge=1, le=100_000)] = Field(default=400, description="A day.")
    parcels: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] = Field(
        default=(1, 2), description="An order's, least and most."
    )
    stops: Zone = Field(default=Zone(base=1.0), description="Where customers are.")
    hours: Hours = Field(default=_DAY_CURVE, description="Orders by hour, in relation.")
    wave_s: Annotated[float, Field(gt=0, le=86400)] = Field(
        default=1800.0, description="Time between waves, in which most parcels are made ready."
    )
    wave_share: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.75, description="Of the orders; the others are ready at any moment."
    )
    wave_due_s: Range = Field(
        default=(4500.0, 7200.0), description="Latest service of a wave's order, after its release."
    )
    express_due_s: Range = Field(default=(2700.0, 4500.0), description="That of the others.")
    service_s: Range = (60.0, 180.0)
    depart_within_s: Seconds = Field(
        default=600.0, description="A vehicle that is ready may leave so much later."
    )
    last_release_s: Seconds = Field(
        default=79200.0, description="Nothing is released later, so that all are home by midnight."
    )
    breaks: Annotated[tuple[Break, ...], Field(max_length=10)] = Field(
        default=(),
        description="Of each vehicle, in their order; `earliest_s` and `latest_s` since midnight.",
    )
    cycle_s: Annotated[float, Field(gt=0, le=3600)] = Field(
        default=300.0, description="Time between dispatch cycles."
    )

    @model_validator(mode="after")
    def _breaks_have_seconds(self) -> Self:
        if any(text is not None for own in self.breaks for text in own.clocks.values()):
            raise ValueError("a simulated day has no clock times: give earliest_s and latest_s")
        return self

    @property
    def vehicle_type(self) -> VehicleType:
        """Of all vehicles. Their batteries last: nobody charges in a simulated day."""
        return PRESETS[self.type].model_copy(update={"battery_kwh": None})

    def digest_text(self) -> str:
        """JSON for digests, which stored arms hold; without breaks as before there were any. The
        type stands beside it.
        """
        return self.model_dump_json(exclude={"type"} if self.breaks else {"type", "breaks"})


def busiest_begin_s(settings: FleetSettings, hours: float) -> float:
    """The whole hour from which on most orders are expected to be released within some hours, s
    since midnight; the first of equal ones. What is left for the day's last release does not count.
    """
    shares = (np.arange(_SHARES) + 0.5) / _SHARES
    ordered_s = departures(settings.hours, shares)
    wave_s = np.ceil(ordered_s / settings.wave_s) * settings.wave_s
    released_s = np.concatenate([wave_s, ordered_s])
    released_s[released_s > settings.last_release_s] = np.inf
    share = np.repeat([settings.wave_share, 1 - settings.wave_share], _SHARES)
    begins_s = 3600.0 * np.arange(max(1, int(24 - hours) + 1))
    counts = [
        share[(begin_s <= released_s) & (released_s < begin_s + 3600 * hours)].sum().round(6)
        for begin_s in begins_s
    ]
    return float(begins_s[int(np.argmax(counts))])


@dataclass(frozen=True)
class Order:
    """One delivery."""

    id: str
    node: str
    release_s: float
    latest_s: float
    service_s: float
    parcels: int


@dataclass(frozen=True)
class Deliveries:
    """What a fleet has to do in a day."""

    settings: FleetSettings
    vehicles: Mapping[str, str]
    orders: tuple[Order, ...]

    def released(self, now_s: float, taken: Collection[str]) -> tuple[Order, ...]:
        """Orders that are ready and not taken."""
        return tuple(o for o in self.orders if o.release_s <= now_s and o.id not in taken)


def draw_deliveries(
    settings: FleetSettings, network: RoadNetwork, seed: int, source: str | Path = "fleet"
) -> Deliveries:
    """Draw a day's orders; same arguments, same orders. Raises InputError: a depot or a customer's
    place that the network has not, or more parcels in an order than a vehicle can carry.
    """
    rng = np.random.default_rng([seed, _STREAM])
    check_zone("stops", settings.stops, network, source)
    if settings.parcels[0] > settings.parcels[1] or settings.parcels[1] > settings.capacity:
        problem = f"{settings.parcels[0]} to {settings.parcels[1]} parcels an order"
        raise InputError(
            source, problem, f"give some within the capacity, {settings.capacity}", key="parcels"
        )
    junctions = tuple(network.junctions)
    weights = zone_weights(settings.stops, network, junctions)
    if weights.sum() <= 0:
        raise InputError(source, "no place has a customer", "give stops a base", key="stops")
    depots = settings.depots or _random_depots(junctions, weights, network, rng)
    for depot in depots:
        if depot.node not in network.junctions:
            raise InputError(
                source,
                f"no junction {depot.node!r} in net {network.name!r}",
                "name one of the net",
                key=f"depots.{depot.id}",
            )
    at_depot = np.isin(junctions, [depot.node for depot in depots])
    weights = np.where(at_depot, 0.0, weights)
    nodes = rng.choice(len(junctions), size=settings.orders, p=weights / weights.sum())
    orders = _orders(settings, [junctions[i] for i in nodes], rng)
    vehicles = {f"van-{k + 1:02}": depots[k % len(depots)].id for k in range(settings.vehicles)}
    return Deliveries(settings.model_copy(update={"depots": depots}), vehicles, orders)


def fleet_at(
    deliveries: Deliveries, now_s: float, idle: Mapping[str, float], taken: Collection[str]
) -> Fleet | None:
    """What the dispatcher is asked in the cycle of a moment; all its times count from then.

    Args:
        idle: when each vehicle is ready at its depot, s since midnight; those on a tour are left
            out.

    Returns:
        None without open orders or free vehicles.
    """
    settings = deliveries.settings
    orders = deliveries.released(now_s, taken)
    if not orders or not idle:
        return None
    stops = tuple(
        Stop(
            id=order.id,
            node=order.node,
            service_s=order.service_s,
            demand=order.parcels,
            latest_s=max(0.0, order.latest_s - now_s),
        )
        for order in orders
    )
    breaks = tuple(
        own.model_copy(
            update={
                "earliest_s": max(own.earliest_s - now_s, -_DAY_S),
                "latest_s": max(own.latest_s - now_s, -_DAY_S),
            }
        )
        for own in settings.breaks
    )
    kind = settings.vehicle_type
    vehicles = tuple(
        Vehicle(
            id=name,
            depot=deliveries.vehicles[name],
            capacity=settings.capacity,
            ready_s=max(0.0, idle[name] - now_s),
            depart_by_s=max(0.0, idle[name] - now_s) + settings.depart_within_s,
            own_type=kind,
            breaks=breaks,
        )
        for name in sorted(idle)
    )
    return Fleet(name=f"cycle-{now_s:.0f}", depots=settings.depots, stops=stops, vehicles=vehicles)


def _random_depots(
    junctions: tuple[str, ...], weights: Array, network: RoadNetwork, rng: np.random.Generator
) -> tuple[Depot, ...]:
    """Two places, the second one as far from the first as any customer is; one where there are no
    more than two, as customers are elsewhere.
    """
    places = np.flatnonzero(weights > 0)
    first = int(rng.choice(places))
    where = np.array([network.junctions[name] for name in junctions], dtype=np.float64)
    away = np.where(weights > 0, np.square(where - where[first]).sum(axis=1), -1.0)
    chosen = list(dict.fromkeys([first, int(away.argmax())]))
    chosen = chosen[: max(1, min(_PLACES, len(places) - 1))]
    return tuple(Depot(id=f"depot-{i}", node=junctions[at]) for i, at in enumerate(chosen, 1))


def _orders(
    settings: FleetSettings, nodes: list[str], rng: np.random.Generator
) -> tuple[Order, ...]:
    count = len(nodes)
    ordered_s = np.minimum(departures(settings.hours, rng.random(count)), settings.last_release_s)
    in_wave = rng.random(count) < settings.wave_share
    wave_s = np.ceil(ordered_s / settings.wave_s) * settings.wave_s
    release_s = np.minimum(np.where(in_wave, wave_s, ordered_s), settings.last_release_s)
    due_s = np.where(
        in_wave,
        rng.uniform(*settings.wave_due_s, count),
        rng.uniform(*settings.express_due_s, count),
    )
    service_s = rng.uniform(*settings.service_s, count)
    parcels = rng.integers(settings.parcels[0], settings.parcels[1] + 1, count)
    return tuple(
        Order(
            id=f"o{number:04}",
            node=nodes[i],
            release_s=round(float(release_s[i]), 1),
            latest_s=round(float(release_s[i] + due_s[i]), 1),
            service_s=round(float(service_s[i]), 1),
            parcels=int(parcels[i]),
        )
        for number, i in enumerate(np.argsort(release_s, kind="stable").tolist(), start=1)
    )
