"""Pictures of the cameras: a stream for as long as it is looked at, and the latest one."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Final

from fastapi import APIRouter, Query
from fastapi.responses import Response

from dashboard.web.pictures import Pictures, picture_key
from dashboard.web.services import Page, PageServices
from dashboard.web.tables.rows import ms
from slipstream.http.problems import Problem
from slipstream.http.streaming import EndlessResponse

SEND_WITHIN_S: Final = 10.0
FIRST_WITHIN_S: Final = 10.0
"""A stream ends where no picture comes for so long."""
TAKEN: Final = "X-Picture-Taken"
"""Header of a picture: ms of UTC at which it was taken."""
_BOUNDARY: Final = "slipstream-picture"

Boxes = Annotated[bool, Query(description="With the boxes that the unit draws.")]

router = APIRouter(prefix="/api/rsus")


@router.get("/{rsu:path}/picture")
async def picture(page: Page, rsu: str, boxes: Boxes = True) -> Response:
    """A stream of JPEGs, as browsers show it in an image."""
    pictures = _pictures(page, rsu)
    return EndlessResponse(
        _parts(pictures, picture_key(rsu, boxes=boxes)),
        f"multipart/x-mixed-replace; boundary={_BOUNDARY}",
        send_within_s=SEND_WITHIN_S,
    )


@router.get("/{rsu:path}/still")
async def still(page: Page, rsu: str, boxes: Boxes = True) -> Response:
    """The latest picture. Browsers keep few connections, so grids of pictures ask for one after the
    other; the unit is asked to send on for a while.
    """
    pictures = _pictures(page, rsu)
    key = picture_key(rsu, boxes=boxes)
    pictures.glance(key)
    found = pictures.latest(key)
    if found is None:
        with pictures.looking(key):
            async for first in pictures.following(key, FIRST_WITHIN_S):
                found = first
                break
    if found is None:
        raise Problem(404, f"no picture came from {rsu}", "look at the unit's health")
    headers = {"Cache-Control": "no-store", TAKEN: str(ms(found.taken_ns))}
    return Response(found.jpeg, media_type="image/jpeg", headers=headers)


def _pictures(page: PageServices, rsu: str) -> Pictures:
    if page.pictures is None or rsu not in page.now().moment["rsus"]:
        raise Problem(404, f"no camera {rsu[:200]} is here", "ask for one of the table's")
    return page.pictures


async def _parts(pictures: Pictures, key: str) -> AsyncIterator[bytes]:
    with pictures.looking(key) as taken:
        if not taken:
            return
        async for one in pictures.following(key, FIRST_WITHIN_S):
            head = (
                f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(one.jpeg)}\r\n"
                f"{TAKEN}: {ms(one.taken_ns)}\r\n\r\n"
            )
            yield head.encode() + one.jpeg + b"\r\n"
