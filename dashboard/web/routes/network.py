"""What a browser is told once: the page's settings, and the roads."""

from __future__ import annotations

import gzip
import hashlib
import threading
from typing import Annotated, Any
from weakref import WeakKeyDictionary

from fastapi import APIRouter, Header, Request
from fastapi.responses import Response

from dashboard.web.hub import encoded
from dashboard.web.services import Page
from dashboard.web.tables.rows import Scene
from slipstream import __version__
from slipstream.roads.projection import Projection

router = APIRouter(prefix="/api")


@router.get("/config")
def config(page: Page, request: Request) -> Response:
    """Settings of the page."""
    settings = page.settings
    scene_url = settings.scene_url
    if scene_url is None and settings.scene_port is not None and page.hub is not None:
        # Under the name that this page was asked for.
        scene_url = f"{request.url.scheme}://{_host(request)}:{settings.scene_port}/"
    return _json(
        {
            "version": __version__,
            "title": settings.title,
            "control": settings.allow_control,
            "scene_url": scene_url,
            "units": settings.units,
            "time_zone": settings.time_zone,
            "co2_kg_per_kwh": settings.co2_kg_per_kwh,
            "price_per_kwh": settings.price_per_kwh,
            "currency": settings.currency,
            "live": page.hub is not None,
            "history": page.past is not None,
        }
    )


@router.get("/network")
def network(
    page: Page,
    if_none_match: Annotated[str | None, Header()] = None,
    accept_encoding: Annotated[str, Header()] = "",
) -> Response:
    """The roads; compressed, with an ETag."""
    plain, packed, tag = _document(page.scene)
    headers = {"ETag": tag, "Vary": "Accept-Encoding"}
    if if_none_match is not None and tag in (part.strip() for part in if_none_match.split(",")):
        return Response(status_code=304, headers=headers)
    if "gzip" in accept_encoding.lower():
        return Response(
            packed, headers=headers | {"Content-Encoding": "gzip"}, media_type="application/json"
        )
    return Response(plain, headers=headers, media_type="application/json")


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


_LOCK = threading.Lock()
_DOCUMENTS: WeakKeyDictionary[Any, tuple[bytes, bytes, str]] = WeakKeyDictionary()


def _document(scene: Scene) -> tuple[bytes, bytes, str]:
    with _LOCK:
        if scene.places not in _DOCUMENTS:
            plain = encoded(network_document(scene))
            tag = f'"{hashlib.sha256(plain).hexdigest()[:32]}"'
            _DOCUMENTS[scene.places] = plain, gzip.compress(plain, 6, mtime=0), tag
        return _DOCUMENTS[scene.places]


def _host(request: Request) -> str:
    name = request.url.hostname or "127.0.0.1"
    return f"[{name}]" if ":" in name else name


def _json(data: object) -> Response:
    return Response(encoded(data), media_type="application/json")
