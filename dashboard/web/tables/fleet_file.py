"""Depots and vehicles out of the fleet's file, as far as the page shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from dashboard.view.places import Places
from dashboard.web.tables.rows import Scene
from slipstream.config import read_data
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.snapping import NoPlaceError, Snapper
from slipstream.vehicle_types import PRESETS, RoutingProfile


def make_scene(network: RoadNetwork, fleet: Path | None, depots: tuple[str, ...]) -> Scene:
    """What is known of roads and fleet beforehand.

    The dispatcher checks the file wholly; here only what is shown of it has to be sound.

    Raises:
        InputError: the file is missing or no fleet.
    """
    if fleet is None:
        return Scene(Places(network), {node: node for node in depots if node in network.junctions})
    data = read_data(fleet)
    if not isinstance(data, Mapping):
        raise InputError(fleet, "not a fleet", "give the dispatcher's fleet file")
    presets = (PRESETS.get(str(row.get("type"))) for row in _rows(data, "vehicles", fleet))
    profiles = {RoutingProfile() if kind is None else kind.profile for kind in presets}
    marked = {}
    for depot in _rows(data, "depots", fleet):
        node = depot.get("node") or _node_at(network, depot, profiles)
        if isinstance(node, str) and node in network.junctions:
            marked[str(depot.get("id", "depot"))] = node
    rows = [row for row in _rows(data, "vehicles", fleet) if "id" in row]
    vehicles = {str(row["id"]): row.get("carrier") for row in rows}
    return Scene(Places(network), marked, vehicles)


def _rows(data: Mapping[str, Any], table: str, fleet: Path) -> list[Mapping[str, Any]]:
    rows = data.get(table, [])
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        raise InputError(
            fleet, "not a list of tables", "give the dispatcher's fleet file", key=table
        )
    return rows


def _node_at(
    network: RoadNetwork, place: Mapping[str, Any], profiles: Iterable[RoutingProfile]
) -> str | None:
    """The junction where the dispatcher serves latitude and longitude."""
    try:
        where = float(place["lat"]), float(place["lon"])
        return Snapper(network, profiles).stop_for(*where).node
    except (ImportError, KeyError, TypeError, ValueError, NoPlaceError):
        return None
