"""Calls of an ASGI application without sockets."""

from __future__ import annotations

import asyncio
import json
import queue
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from typing import Any
from urllib.parse import unquote

WITHIN_S = 60.0
Send = Callable[[dict[str, Any]], None]


@dataclass
class Answer:
    """What a request was answered with."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


class Request:
    """One request, as a server hands it on."""

    def __init__(
        self, app: Any, method: str, target: str, headers: Mapping[str, str], body: bytes = b""
    ) -> None:
        self._app, self._body = app, body
        path, _, query = target.partition("?")
        sent = {"host": "localhost", **{name.lower(): value for name, value in headers.items()}}
        if body or method == "POST":
            sent["content-length"] = str(len(body))
        self._scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": unquote(path),
            "raw_path": path.encode(),
            "root_path": "",
            "query_string": query.encode(),
            "headers": [(n.encode("latin-1"), v.encode("latin-1")) for n, v in sent.items()],
            "client": ("127.0.0.1", 1),
            "server": ("localhost", 80),
            "state": {"abort": lambda: None},
        }

    def answer(self, loop: asyncio.AbstractEventLoop) -> Answer:
        """The whole answer."""
        said: list[dict[str, Any]] = []
        asyncio.run_coroutine_threadsafe(self._run(said.append), loop).result(WITHIN_S)
        start, *parts = said
        names = {name.decode().lower(): value.decode("latin-1") for name, value in start["headers"]}
        return Answer(start["status"], names, b"".join(part.get("body", b"") for part in parts))

    @contextmanager
    def followed(self, loop: asyncio.AbstractEventLoop) -> Iterator[Iterator[bytes]]:
        """The parts of an answer as they come; after the block the caller is gone."""
        said: queue.Queue[dict[str, Any]] = queue.Queue()
        running = asyncio.run_coroutine_threadsafe(self._run(said.put), loop)
        assert said.get(timeout=WITHIN_S)["status"] == 200

        def parts() -> Iterator[bytes]:
            while (part := said.get(timeout=WITHIN_S)).get("more_body", False):
                yield part["body"]

        try:
            yield parts()
        finally:
            running.cancel()

    async def _run(self, say: Send) -> None:
        gone, bodies = asyncio.Event(), [self._body]

        async def receive() -> dict[str, Any]:
            if bodies:
                return {"type": "http.request", "body": bodies.pop(), "more_body": False}
            await gone.wait()
            return {"type": "http.disconnect"}

        async def send(message: dict[str, Any]) -> None:
            say(message)

        await self._app(self._scope, receive, send)


class Listener:
    """A caller that reads a stream of events.

    Attributes:
        lines: of its events, as they come.
    """

    def __init__(self, parts: Iterator[bytes]) -> None:
        self.lines = (line for part in parts for line in part.decode().split("\n") if line)

    def event(self) -> tuple[str, Any, str | None]:
        """The next event: its kind, data and id."""
        number, kind = None, ""
        for line in self.lines:
            name, _, value = line.partition(": ")
            if name == "id":
                number = value
            elif name == "event":
                kind = value
            elif name == "data":
                return kind, json.loads(value), number
        raise EOFError

    def rest(self) -> int:
        """Number of events until the stream ends, however it does."""
        for number in count():
            try:
                self.event()
            except (EOFError, ConnectionResetError):
                return number
        raise AssertionError
