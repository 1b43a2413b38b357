"""What a browser is told once: the page's settings, and the roads."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import Response

from dashboard.web.services import Page, as_json
from slipstream import __version__

router = APIRouter(prefix="/api")


@router.get("/config")
def config(page: Page, request: Request) -> Response:
    """Settings of the page."""
    settings = page.settings
    scene_url = settings.scene_url
    if scene_url is None and settings.scene_port is not None and page.hub is not None:
        # Under the name that this page was asked for.
        scene_url = f"{request.url.scheme}://{_host(request)}:{settings.scene_port}/"
    return as_json(
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
def network(page: Page, request: Request) -> Response:
    """The roads; compressed, with an ETag."""
    return page.network.answer(request.headers)


def _host(request: Request) -> str:
    name = request.url.hostname or "127.0.0.1"
    return f"[{name}]" if ":" in name else name
