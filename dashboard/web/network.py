"""The road network as a browser gets it; pure."""

from __future__ import annotations

from typing import Any

from dashboard.web.tables.rows import Scene
from slipstream.roads.projection import Projection


def network_document(scene: Scene) -> dict[str, Any]:
    """The roads as a browser gets them: places to 0.1 m."""
    roads = scene.places.network
    projection = roads.projection
    places = ((name, roads.junctions.get(node)) for name, node in sorted(scene.depots.items()))
    return {
        "id": roads.name,
        "bounds": [round(value, 1) for value in roads.bounds_m()],
        "left_hand": roads.left_hand,
        "origin": None if projection is None else _origin(projection),
        "roads": [
            {
                "id": segment.id,
                "name": segment.name or None,
                "shape": [round(value, 1) for point in segment.shape for value in point],
                "length_m": round(segment.length_m, 1),
                "limit_kmh": round(segment.speed_limit_mps * 3.6),
                "lanes": segment.lanes,
            }
            for segment in roads.segments.values()
        ],
        "depots": [
            {"id": name, "x": round(place[0], 1), "y": round(place[1], 1)}
            for name, place in places
            if place is not None
        ],
    }


def _origin(projection: Projection) -> dict[str, float] | None:
    """Latitude and longitude of the plane's origin; None where nothing can tell them."""
    try:
        ((latitude, longitude),) = projection.degrees([(0.0, 0.0)])
    except (ImportError, ValueError):  # pyproj comes with the dispatcher
        return None
    return {"lat": round(latitude, 6), "lon": round(longitude, 6)}
