"""Answers that go on until either side ends them: events, pictures."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping

from fastapi.responses import Response
from starlette.types import Receive, Scope, Send

from slipstream.http.bodies import abort


class EndlessResponse(Response):
    """Sends parts until they end, the caller goes, or takes one too slowly: then it is cut off.

    Args:
        parts: of the body. It ends early, by `aclose`, if the caller goes.
        media_type: of all of them.
        send_within_s: time in which a caller has to take a part.
        headers: further ones.
        end: called in the end, with True if the caller was too slow.
    """

    def __init__(
        self,
        parts: AsyncIterator[bytes],
        media_type: str,
        *,
        send_within_s: float,
        headers: Mapping[str, str] | None = None,
        end: Callable[[bool], None] = lambda _: None,
    ) -> None:
        own = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(headers=own | dict(headers or {}), media_type=media_type)
        self._parts, self._within_s, self._end = parts, send_within_s, end
        del self.headers["content-length"]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send."""
        slow = False

        async def put(body: bytes, *, more: bool = True) -> None:
            nonlocal slow
            try:
                async with asyncio.timeout(self._within_s):
                    await send({"type": "http.response.body", "body": body, "more_body": more})
            except TimeoutError:
                slow = True
                raise

        async def send_all() -> None:
            start = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
            await send(start)
            async for part in self._parts:
                await put(part)
            await put(b"", more=False)

        async def follow() -> None:
            while (await receive())["type"] != "http.disconnect":
                pass

        tasks = [asyncio.create_task(send_all()), asyncio.create_task(follow())]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                if not (slow and task is tasks[0]):
                    task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            close = getattr(self._parts, "aclose", None)
            if close is not None:
                await close()
            self._end(slow)
            if slow:
                abort(scope)
