"""Places by latitude and longitude, served where the roads near them allow it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.stops import Place
from slipstream.errors import InputError, refuse
from slipstream.roads import RoadNetwork
from slipstream.roads.snapping import NoPlaceError, Snapped, Snapper
from slipstream.vehicle_types import RoutingProfile

_TABLES: Final = ("depots", "stops", "charging_stops", "hubs")
_UNKNOWN_NODE: Final = "by latitude and longitude"


def with_unknown_nodes(data: object) -> object:
    """Plain data in which a place with latitude and longitude alone has a node to be found."""
    if not isinstance(data, Mapping):
        return data

    def placed(rows: object) -> object:
        if not isinstance(rows, list | tuple):
            return rows
        return [
            {"node": _UNKNOWN_NODE, **row}
            if isinstance(row, Mapping) and ("lat" in row or "lon" in row)
            else row
            for row in rows
        ]

    return {key: placed(rows) if key in _TABLES else rows for key, rows in data.items()}


def located(fleet: Fleet, network: RoadNetwork, source: str | Path) -> Fleet:
    """The fleet with the nodes of its places that are given by latitude and longitude.

    Raises:
        InputError: the network has no projection, or a place is too far from any road where a
            vehicle of the fleet may stop.
    """
    places = list(_places(fleet))
    if all(place.node != _UNKNOWN_NODE for _, place in places):
        return fleet
    snapper = snapper_of(fleet, network)
    found: dict[str, list[Place]] = {table: [] for table in _TABLES}
    faults: list[InputError] = []
    for table, place in places:
        if place.node == _UNKNOWN_NODE:
            try:
                place = place.model_copy(update={"node": _snapped(place, snapper).node})
            except NoPlaceError as error:
                key = f"{table}.{place.id}.lat"
                faults.append(InputError(source, error.problem, error.mend, key=key))
        found[table].append(place)
    refuse(faults)
    return Fleet(**fleet.parts | {table: tuple(rows) for table, rows in found.items()})


@dataclass(frozen=True)
class Served:
    """Where a place that has latitude and longitude is served.

    Attributes:
        road: that was found near the place; None: the file names the junction.
    """

    key: str
    node: str
    to_node_m: float
    road: Snapped | None

    def __str__(self) -> str:
        by = "by the file"
        if self.road is not None:
            by = f"at an end of {self.road.segment!r}, {self.road.distance_m:.0f} m from the place"
        return f"{self.key}: served {self.to_node_m:.0f} m away, at {self.node}, {by}"


def served(fleet: Fleet, network: RoadNetwork) -> Iterator[Served]:
    """Each place of a located fleet that has latitude and longitude, as far as the network knows
    them.
    """
    given = [(f"{table}.{p.id}", p) for table, p in _places(fleet) if p.lat is not None]
    if not given or network.projection is None:
        return
    snapper = snapper_of(fleet, network)
    for key, place in given:
        road = None
        with suppress(NoPlaceError):
            road = _snapped(place, snapper)
        if road is not None and road.node == place.node:
            yield Served(key, place.node, road.to_node_m, road)
        elif (away_m := to_node_m(network, place.lat, place.lon, place.node)) is not None:
            yield Served(key, place.node, away_m, None)


def to_node_m(
    network: RoadNetwork, latitude: float | None, longitude: float | None, node: str
) -> float | None:
    """From a place in degrees to a junction, m; None: one of them is not known."""
    if None in (latitude, longitude, network.projection) or node not in network.junctions:
        return None
    assert network.projection is not None
    assert latitude is not None
    assert longitude is not None
    try:
        return math.dist(network.projection.place_m(latitude, longitude), network.junctions[node])
    except ValueError:
        return None


def _places(fleet: Fleet) -> Iterator[tuple[str, Place]]:
    yield from (("depots", depot) for depot in fleet.depots)
    yield from (("stops", stop) for stop in fleet.stops)
    yield from (("charging_stops", stop) for stop in fleet.charging_stops)
    yield from (("hubs", hub) for hub in fleet.hubs)


def snapper_of(fleet: Fleet | None, network: RoadNetwork) -> Snapper:
    """Finds roads that some vehicle of a fleet may use; None: one without a type."""
    kinds = [None] if fleet is None else [fleet.type_of(vehicle) for vehicle in fleet.vehicles]
    return Snapper(network, {RoutingProfile() if k is None else k.profile for k in kinds})


def _snapped(place: Place, snapper: Snapper) -> Snapped:
    assert place.lat is not None
    assert place.lon is not None
    return snapper.stop_for(place.lat, place.lon)
