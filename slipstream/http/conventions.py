"""What callers of any HTTP server expect: HEAD wherever GET is, and a path with a slash at its end.

It stands before everything else, so that paths and methods are those that all else knows.
"""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send


class Conventions:
    """ASGI middleware.

    HEAD is answered as GET without the body; an answer without an end is ended. Slashes at the end
    of a path are left out, unless they are percent-encoded: an id may end with one.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "http":
            scope = {**scope, "path": _plain(scope["path"], scope.get("raw_path"))}
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return
        answered = asyncio.Event()

        async def head(message: Message) -> None:
            if message["type"] == "http.response.start":
                await send(message)
                await send({"type": "http.response.body", "body": b"", "more_body": False})
                answered.set()

        async def followed() -> Message:
            # Nobody reads on: parts that would follow need not be made.
            if not answered.is_set():
                asked = asyncio.ensure_future(receive())
                over = asyncio.ensure_future(answered.wait())
                await asyncio.wait((asked, over), return_when=asyncio.FIRST_COMPLETED)
                over.cancel()
                if asked.done():
                    return asked.result()
                asked.cancel()
            return {"type": "http.disconnect"}

        await self._app({**scope, "method": "GET"}, followed, head)


def _plain(path: str, raw: bytes | None) -> str:
    written = path.encode() if raw is None else raw
    slashes = len(written) - len(written.rstrip(b"/"))
    return path[: len(path) - slashes] or "/" if slashes else path
