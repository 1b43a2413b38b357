"""The application: its routers, what all of them share, and its OpenAPI document."""

from __future__ import annotations

from typing import Any, Final

from fastapi import APIRouter, Depends, FastAPI
from fastapi.openapi.utils import get_openapi

from dispatcher_daemon.service.api.body import collect_definitions
from dispatcher_daemon.service.api.endpoints import (
    alarms,
    control,
    cycles,
    energy,
    events,
    feeds,
    health,
    orders,
    segments,
    solve,
    vehicles,
    vroom,
)
from dispatcher_daemon.service.api.parameters import refuse_unknown_parameters
from dispatcher_daemon.service.api.services import Services
from slipstream import __version__
from slipstream.http.problems import (
    PROBLEM_RESPONSES,
    ProblemDocument,
    handle_problems,
)
from storage import StorageError

ROUTERS: Final[tuple[APIRouter, ...]] = (
    orders.router,
    vehicles.router,
    cycles.router,
    energy.router,
    segments.router,
    feeds.router,
    events.router,
    alarms.router,
    control.router,
    solve.router,
    vroom.router,
    health.router,
)
"""A further room of the API is a module with a `router`, and its line here. Operations name the
scope that their callers need (`auth.requires`); bodies are read by `body.body_of`.
"""

_DESCRIPTION: Final = (
    "What the dispatcher knows and does. Every refusal is a problem document (RFC 9457) with the "
    "members `field` and `mend`. Times are UTC in nanoseconds since 1970."
)


def create_app(services: Services | None = None) -> FastAPI:
    """The application."""
    app = FastAPI(
        title="Slipstream dispatcher",
        version=__version__,
        description=_DESCRIPTION,
        dependencies=[Depends(refuse_unknown_parameters)],
        responses=PROBLEM_RESPONSES,
        openapi_url=None,
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.services = services
    for router in ROUTERS:
        app.include_router(router)
    handle_problems(app, paths="docs/api.md", unavailable=(StorageError,))
    orders.handle_refusals(app)
    control.handle_refusals(app)
    app.openapi = lambda: _document(app)  # type: ignore[method-assign]
    return app


def _document(app: FastAPI) -> dict[str, Any]:
    document = get_openapi(
        title=app.title,
        version=app.version,
        description=app.description,
        routes=app.routes,
    )
    collect_definitions(document)
    schemas = document["components"]["schemas"]
    schemas["ProblemDocument"] = ProblemDocument.model_json_schema()
    for operations in document["paths"].values():
        for operation in operations.values():
            # What is wrong with a request is told by a problem document, as all else.
            operation["responses"].pop("422", None)
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    return document
