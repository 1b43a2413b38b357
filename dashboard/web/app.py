"""The application of the operator's page: its routes, and what each request passes before."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Final

from fastapi import APIRouter, FastAPI
from starlette.types import ASGIApp

from dashboard.web.guard import PageGuard
from dashboard.web.routes import cameras, cards, control, history, live, network
from dashboard.web.services import PageServices
from dashboard.web.static_files import StaticFiles
from slipstream import __version__
from slipstream.http.problems import handle_problems
from storage import StorageError

ROUTERS: Final[tuple[APIRouter, ...]] = (
    network.router,
    live.router,
    # Before the cards, whose ids may hold slashes.
    cameras.router,
    history.router,
    control.router,
    cards.router,
)
"""A further room of the page is a module with a `router`, and its line here."""

STATIC: Final = Path(str(resources.files("dashboard") / "web" / "static"))


def make_app(services: PageServices) -> ASGIApp:
    """The application, behind its guard."""
    app = FastAPI(title="Slipstream", version=__version__, openapi_url=None, redirect_slashes=False)
    app.state.services = services
    for router in ROUTERS:
        app.include_router(router)

    files = StaticFiles(STATIC)
    for path in ("/", "/static/{path:path}"):
        app.add_route(path, files.answer, methods=["GET"])
    handle_problems(app, paths="docs/page.md", unavailable=(StorageError,))
    settings = services.settings
    return PageGuard(app, settings.host.lower(), frozenset(map(str.lower, settings.allowed_hosts)))
