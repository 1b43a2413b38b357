"""Places by latitude and longitude, snapped to the nearest road that a fleet's vehicles may use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.stops import Place
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.snapping import Snapped, Snapper
from slipstream.vehicle_types import RoutingProfile

MAX_SNAP_M: Final = 200.0
"""From a place to its road; one further away is refused."""
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
        InputError: the network has no projection, or a place is too far from any road that a
            vehicle of the fleet may use.
    """
    places = list(_places(fleet))
    if all(place.node != _UNKNOWN_NODE for _, place in places):
        return fleet
    snapper = snapper_of(fleet, network)
    found: dict[str, list[Place]] = {table: [] for table in _TABLES}
    for table, place in places:
        if place.node == _UNKNOWN_NODE:
            node = _snapped(place, network, snapper, source, f"{table}.{place.id}").node
            place = place.model_copy(update={"node": node})
        found[table].append(place)
    return Fleet(**fleet.parts | {table: tuple(rows) for table, rows in found.items()})


def distances(
    fleet: Fleet, network: RoadNetwork, source: str | Path
) -> Iterator[tuple[str, Snapped]]:
    """Each place that is given by latitude and longitude, with its road; errors as in `located`."""
    given = [(f"{table}.{p.id}", p) for table, p in _places(fleet) if p.lat is not None]
    if given:
        snapper = snapper_of(fleet, network)
        for key, place in given:
            yield key, _snapped(place, network, snapper, source, key)


def _places(fleet: Fleet) -> Iterator[tuple[str, Place]]:
    yield from (("depots", depot) for depot in fleet.depots)
    yield from (("stops", stop) for stop in fleet.stops)
    yield from (("charging_stops", stop) for stop in fleet.charging_stops)
    yield from (("hubs", hub) for hub in fleet.hubs)


def snapper_of(fleet: Fleet | None, network: RoadNetwork) -> Snapper:
    """Finds roads that some vehicle of a fleet may use; None: one without a type."""
    kinds = [None] if fleet is None else [fleet.type_of(vehicle) for vehicle in fleet.vehicles]
    return Snapper(network, {RoutingProfile() if k is None else k.profile for k in kinds})


def _snapped(
    place: Place, network: RoadNetwork, snapper: Snapper, source: str | Path, key: str
) -> Snapped:
    if network.projection is None or place.lat is None or place.lon is None:
        problem = f"network {network.name!r} knows no latitude and longitude"
        raise InputError(source, problem, "name a junction as node", key=f"{key}.lat")
    try:
        snapped = snapper.nearest(network.projection.place_m(place.lat, place.lon))
    except ValueError as error:
        mend = "name a junction as node"
        raise InputError(source, str(error), mend, key=f"{key}.lat") from None
    if snapped is None:
        problem = "no road that a vehicle of the fleet may use"
        raise InputError(source, problem, "check the vehicles' types", key=f"{key}.lat")
    if snapped.distance_m > MAX_SNAP_M:
        problem = f"{snapped.distance_m:.0f} m from the nearest road that its vehicles may use"
        mend = f"give a place within {MAX_SNAP_M:.0f} m of one"
        raise InputError(source, problem, mend, key=f"{key}.lat")
    return snapped
