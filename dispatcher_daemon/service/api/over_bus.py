"""The API over the bus: questions on keys, answered by the operations that HTTP reaches."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Collection
from typing import Any, Final, Protocol
from urllib.parse import quote, unquote

from fastapi.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api.auth import API_ROOT, SCOPES, Client
from dispatcher_daemon.service.api.gate import (
    BURST,
    LARGE_BODIES,
    MAX_BODY_BYTES,
    MAX_RUNNING,
    RATE_PER_S,
)
from dispatcher_daemon.service.api.problems import FAULT, MEDIA_TYPE, Problem
from dispatcher_daemon.settings import Scope
from slipstream.answers import Question
from slipstream.http.bodies import WITH_BODY
from slipstream.http.guard import answer
from slipstream.http.rate import RateLimit
from slipstream.inbox import MAX_MESSAGE_BYTES
from slipstream.messages import ALL_API
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

CALLER: Final = "bus"
"""Whom the log names: the bus does not say which of its users asks."""
ENDLESS: Final = frozenset({"/v1/events"})
"""Operations whose answer has no end."""
_STOP_WITHIN_S: Final = 5.0


class Questioned(Protocol):
    """The part of `slipstream.bus.Bus` that is used here."""

    def take_questions(self, key_expression: str, take: Callable[[Question], None]) -> None:
        """Hand questions on."""
        ...


class ApiOverBus:
    """Answers questions on `ALL_API` from `listen` until it is closed, several at once.

    A key is ``{scope}/{method}/{path}`` below `API_ROOT`, with the path's chunks percent-encoded;
    the selector's parameters are the query's, the payload is the body. An answer's attachment is
    the HTTP status; a refusal is an error with a problem document.

    Args:
        app: the application behind HTTP.
        scopes: that are served.
        rate: of all questions together.
    """

    def __init__(
        self, app: ASGIApp, scopes: Collection[Scope], rate: RateLimit | None = None
    ) -> None:
        self._app, self._scopes = app, frozenset(scopes)
        self._rate = rate or RateLimit(RATE_PER_S, BURST)
        self._limiter = LogLimiter()
        self._running = 0
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._ending: asyncio.Event | None = None
        self._started = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._run()), name="the API over the bus", daemon=True
        )

    def listen(self, bus: Questioned) -> None:
        """Answer from now on."""
        self._thread.start()
        self._started.wait()
        bus.take_questions(ALL_API, self.take)

    def take(self, question: Question) -> None:
        """Take in one question; returns at once."""
        with self._lock:
            loop, full = self._loop, self._running >= MAX_RUNNING
            if loop is None:
                return
            if not full:
                self._running += 1
                loop.call_soon_threadsafe(self._begin, question)
        if full:
            detail = f"{MAX_RUNNING} questions are being worked on"
            _refuse(question, Problem(503, detail, "try again later"))

    def close(self) -> None:
        """End the thread; questions that are worked on get no answer."""
        with self._lock:
            loop, self._loop = self._loop, None
        if loop is not None and self._ending is not None:
            loop.call_soon_threadsafe(self._ending.set)
        if self._thread.is_alive():
            self._thread.join(_STOP_WITHIN_S)

    async def _run(self) -> None:
        self._ending = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._started.set()
        await self._ending.wait()

    def _begin(self, question: Question) -> None:
        task = asyncio.get_running_loop().create_task(self._answer(question))
        self._tasks.add(task)
        task.add_done_callback(self._end)

    def _end(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        with self._lock:
            self._running -= 1
        if not task.cancelled() and task.exception() is not None and self._limiter.allow("reply"):
            log.warning("a question over the bus has no answer: %s", task.exception())

    async def _answer(self, question: Question) -> None:
        try:
            scope = self._scope_of(question)
        except Problem as problem:
            metrics.API_REQUESTS.labels(str(problem.status)).inc()
            await run_in_threadpool(_refuse, question, problem)
            return
        status, kind, parts, whole = 500, MEDIA_TYPE, list[bytes](), False

        def started(message: Message) -> None:
            nonlocal status, kind
            status = message["status"]
            kind = Headers(raw=message["headers"]).get("content-type", kind)
            metrics.API_REQUESTS.labels(str(status)).inc()

        async def send(message: Message) -> None:
            nonlocal whole
            parts.append(message.get("body", b""))
            whole = message["type"] == "http.response.body" and not message.get("more_body", False)

        async def admitted() -> Receive:
            return self._admitted(question, scope)

        await answer(self._app, scope, send, admitted, started, log, self._limiter)
        body = b"".join(parts)
        if not whole:
            await run_in_threadpool(_refuse, question, FAULT)
        elif status >= 400:
            await run_in_threadpool(question.refuse, body, kind)
        elif len(body) > MAX_MESSAGE_BYTES:
            detail = f"the answer has {len(body) / 1e6:.1f} MB, more than the bus carries"
            too_large = Problem(413, detail, "ask for less at once, or over HTTP")
            await run_in_threadpool(_refuse, question, too_large)
        else:
            await run_in_threadpool(question.answer, body, kind, str(status).encode())

    def _scope_of(self, question: Question) -> dict[str, Any]:
        """The question as ASGI's scope of a request. Raises Problem."""
        if "*" in question.key:
            # Access is given by key: nobody may do by a pattern what it may not do by a key.
            raise Problem(400, "a pattern of keys", "ask on one key", field="key")
        asked, *rest = question.key.removeprefix(API_ROOT).lstrip("/").split("/")
        found = next((scope for scope in SCOPES if scope == asked), None)
        if found is None or len(rest) < 2:
            mend = f"ask on {API_ROOT}/{'|'.join(SCOPES)}/METHOD/PATH, as .../read/get/vehicles"
            raise Problem(404, "no key of the API", mend, field="key")
        if found not in self._scopes:
            detail = f"the scope {found!r} is not served over the bus"
            raise Problem(403, detail, "have it put into api.bus of the dispatcher", field="key")
        method, *chunks = rest
        path = "/v1/" + "/".join(unquote(chunk) for chunk in chunks)
        if path in ENDLESS:
            mend = "subscribe to the keys of docs/wire.md"
            raise Problem(404, "events have no end, and an answer has one", mend, field="key")
        # zenoh keeps parameters that begin with _ for itself.
        parameters = [p for p in question.parameters.split(";") if p and not p.startswith("_")]
        headers = [(b"host", b"bus"), (b"content-length", str(question.size).encode())]
        if question.size:
            headers.append((b"content-type", b"application/json"))
        return {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": "1.1",
            "method": method.upper(),
            "scheme": "http",
            "path": path,
            "raw_path": quote(path).encode(),
            "query_string": "&".join(parameters).encode(),
            "root_path": "",
            "headers": headers,
            "client": None,
            "server": None,
            "state": {
                "client": Client(CALLER, frozenset({found}), over_bus=True),
                "abort": lambda: None,
            },
        }

    def _admitted(self, question: Question, scope: dict[str, Any]) -> Receive:
        """The question's payload as a request's body. Raises Problem."""
        wait_s = self._rate.wait_s(CALLER, time.monotonic())
        if wait_s > 0:
            detail = f"more than {self._rate.rate_per_s:g} questions a second"
            raise Problem(429, detail, "send fewer")
        limit = min(LARGE_BODIES.get(scope["path"], MAX_BODY_BYTES), MAX_MESSAGE_BYTES)
        if question.size > limit:
            detail = f"the payload is larger than {limit / 1e6:g} MB"
            raise Problem(413, detail, "send less at once")
        body = question.payload() if scope["method"] in WITH_BODY else b""

        async def receive() -> Message:
            return {"type": "http.request", "body": body, "more_body": False}

        return receive


def _refuse(question: Question, problem: Problem) -> None:
    question.refuse(bytes(problem.response().body), MEDIA_TYPE)
