"""Feeds for road authorities: DATEX II and WZDx documents."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from email.utils import format_datetime, parsedate_to_datetime
from typing import Any, Final

from fastapi import APIRouter, Request
from fastapi.responses import Response

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.services import Dispatch
from dispatcher_daemon.service.feeds import EXTENSION_SCHEMA
from dispatcher_daemon.service.feeds.publisher import Document
from slipstream.errors import InputError
from slipstream.http.problems import from_input_error

router = APIRouter(prefix="/v1/feeds", tags=["feeds"], dependencies=[requires("read")])

XML: Final = "application/xml"
GEOJSON: Final = "application/geo+json"
_TEXT: Final[dict[str, Any]] = {"schema": {"type": "string"}}
_UNCHANGED: Final[dict[str, Any]] = {"description": "It is the one that the caller has."}
_IN_XML: Final[dict[int | str, dict[str, Any]]] = {
    200: {"content": {XML: _TEXT}},
    304: _UNCHANGED,
}
_IN_GEOJSON: Final[dict[int | str, dict[str, Any]]] = {
    200: {"content": {GEOJSON: {"schema": {"type": "object"}}}},
    304: _UNCHANGED,
}


@router.get("/datex2/sites", response_class=Response, responses=_IN_XML)
def datex2_sites(request: Request, dispatch: Dispatch) -> Response:
    """DATEX II v3: the MeasurementSiteTablePublication. It changes with the sites only."""
    return _answer(request, dispatch.feeds.sites, XML)


@router.get("/datex2/measured", response_class=Response, responses=_IN_XML)
def datex2_measured(request: Request, dispatch: Dispatch) -> Response:
    """DATEX II v3: the MeasuredDataPublication of the sites. It changes once a second at most."""
    return _answer(request, dispatch.feeds.measured, XML)


@router.get(
    "/datex2/extension.xsd",
    response_class=Response,
    responses={200: {"content": {XML: _TEXT}}},
)
def datex2_extension() -> Response:
    """The XML schema of the level B extension in the measured data."""
    return Response(EXTENSION_SCHEMA.read_bytes(), media_type=XML)


@router.get("/wzdx", response_class=Response, responses=_IN_GEOJSON)
def wzdx(request: Request, dispatch: Dispatch) -> Response:
    """WZDx 4.2: the DeviceFeed. It changes once a second at most."""
    return _answer(request, dispatch.feeds.devices, GEOJSON)


def _answer(request: Request, document_of: Callable[[], Document], media_type: str) -> Response:
    try:
        document = document_of()
    except InputError as error:
        # Nothing in the request is wrong: this dispatcher has no such document, or not yet.
        raise from_input_error(error, 404) from None
    made = datetime.fromtimestamp(document.time_ns // 10**9, UTC)
    # Weak: it is the same document, packed or not.
    etag = f'W/"{document.digest}"'
    headers = {
        "ETag": etag,
        "Last-Modified": format_datetime(made, usegmt=True),
        "Cache-Control": "private, no-cache",
        "Vary": "Accept-Encoding, Authorization",
    }
    if _has(request, etag, made):
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return Response(document.packed, headers=headers, media_type=media_type)
    return Response(document.body, headers=headers, media_type=media_type)


def _has(request: Request, etag: str, made: datetime) -> bool:
    """Whether the caller has the document already (RFC 9110, section 13)."""
    known = request.headers.get("if-none-match")
    if known is not None:
        tags = {tag.strip() for tag in known.split(",")}
        return "*" in tags or etag in tags or etag.removeprefix("W/") in tags
    try:
        since = parsedate_to_datetime(request.headers.get("if-modified-since", ""))
    except (ValueError, OverflowError):
        return False
    return since.tzinfo is not None and made <= since
