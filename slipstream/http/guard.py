"""One request answered, whatever its application raises."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from slipstream.http.bodies import DisconnectedError, abort
from slipstream.http.problems import FAULT, Problem
from slipstream.service import LogLimiter


async def answer(
    app: ASGIApp,
    scope: Scope,
    send: Send,
    admitted: Callable[[], Awaitable[Receive]],
    started: Callable[[Message], None],
    log: logging.Logger,
    limiter: LogLimiter,
) -> None:
    """Answer a request; problems become documents, faults a line of the log, and none is raised.

    Args:
        admitted: the request's body as the application receives it; raises Problem.
        started: told each answer's start, before it is sent.
    """
    begun = ended = False

    async def watched(message: Message) -> None:
        nonlocal begun, ended
        if message["type"] == "http.response.start":
            begun = True
            started(message)
        elif not message.get("more_body", False):
            ended = True
        await send(message)

    async def nothing() -> Message:
        return {"type": "http.disconnect"}

    try:
        inner = await admitted()
        await app(scope, inner, watched)
    except Problem as problem:
        await problem.response()(scope, nothing, watched)
    except DisconnectedError:
        pass
    except Exception as error:
        if limiter.allow("fault"):
            log.exception("%s %.200a failed: %s", scope["method"], scope["path"], error)
        if not begun:
            await FAULT.response()(scope, nothing, watched)
        elif not ended:
            # The rest cannot be sent; the caller must not take it for whole.
            abort(scope)
