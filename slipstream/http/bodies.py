"""Bodies of requests, received whole within limits, and connections that are broken off."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from starlette.datastructures import Headers
from starlette.types import Message, Receive, Scope

from slipstream.http.problems import Problem

WITH_BODY: Final = frozenset({"POST", "PUT", "PATCH", "DELETE"})
"""Methods whose requests may have one."""
BODY_WITHIN_S: Final = 15.0


class DisconnectedError(Exception):
    """The caller went away in the middle of its request."""


async def received(headers: Headers, receive: Receive, limit: int) -> Receive:
    """The whole body, bounded in size and time, as a `Receive` for the application.

    Raises:
        Problem: it is too large or too slow.
        DisconnectedError: the caller went away.
    """
    declared = headers.get("content-length", "0")
    too_large = Problem(
        413,
        f"the body is larger than {limit / 1e6:g} MB",
        "send less at once",
        headers={"Connection": "close"},
    )
    if not declared.isdecimal() or int(declared) > limit:
        raise too_large
    body = bytearray()
    try:
        async with asyncio.timeout(BODY_WITHIN_S):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise DisconnectedError
                body += message.get("body", b"")
                if len(body) > limit:
                    raise too_large
                if not message.get("more_body", False):
                    break
    except TimeoutError:
        detail = f"the body did not come within {BODY_WITHIN_S:g} s"
        raise Problem(408, detail, "send it faster", headers={"Connection": "close"}) from None
    sent = False

    async def replayed() -> Message:
        nonlocal sent
        if sent:
            return await receive()
        sent = True
        return {"type": "http.request", "body": bytes(body), "more_body": False}

    return replayed


def abort(scope: Scope) -> None:
    """Close a request's connection at once, with what it has not taken yet."""
    close: Callable[[], None] = scope["state"]["abort"]
    close()
