"""Actions of operators: handed on to the dispatcher's HTTP API with the caller's own token."""

from __future__ import annotations

import logging
import threading
import time
from typing import Annotated, Any, Final

from fastapi import APIRouter, Header, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response

from dashboard.web.routes.actions import Action, ActionCall, call_of, told
from dashboard.web.services import Page, as_json
from slipstream.config import check, parse_json
from slipstream.errors import InputError
from slipstream.http.client import Answer, ApiClient
from slipstream.http.problems import Problem, from_input_error
from slipstream.http.rate import RateLimit

log = logging.getLogger(__name__)

WITHIN_S: Final = 15.0
RATE_PER_S: Final = 1.0
BURST: Final = 10.0
"""Actions of one address."""
MAX_RUNNING: Final = 4
"""Calls that wait for the dispatcher at once."""
_SOURCE: Final = "request"
_TOKEN_MEND: Final = "enter yours; who runs the dispatcher makes one with `slipstream token new`"

router = APIRouter(prefix="/api")
_rate: Final = RateLimit(RATE_PER_S, BURST)
_running: Final = threading.BoundedSemaphore(MAX_RUNNING)


@router.post("/actions")
async def act(
    page: Page,
    request: Request,
    authorization: Annotated[str, Header(max_length=500)] = "",
    content_type: Annotated[str, Header(max_length=200)] = "",
) -> Response:
    """Have the dispatcher do something."""
    if not page.settings.allow_control:
        raise Problem(403, "this page only shows", "start it with --allow-control")
    remote = "unknown" if request.client is None else request.client.host
    wait_s = _rate.wait_s(remote, time.monotonic())
    if wait_s > 0:
        after = {"Retry-After": str(max(1, round(wait_s)))}
        raise Problem(429, "too many actions", "wait a little", headers=after)
    kind, _, token = authorization.partition(" ")
    if kind.lower() != "bearer" or not token:
        raise Problem(401, "a token is missing", _TOKEN_MEND, field="Authorization")
    # A form of another site cannot send this type.
    if content_type.partition(";")[0].strip().lower() != "application/json":
        raise Problem(415, "not JSON", "send Content-Type: application/json", field="Content-Type")
    body = await request.body()
    try:
        action = check(parse_json(body, _SOURCE), Action, _SOURCE)
    except InputError as error:
        raise from_input_error(error) from None
    client = ApiClient(page.settings.dispatcher_api, "dispatcher_api")
    answer = await run_in_threadpool(_call, client, call_of(action), token.strip())
    text = told(action)
    _log(action, remote, answer)
    if answer.status >= 400:
        raise _refusal(answer)
    return as_json({"text": text})


def _call(client: ApiClient, call: ActionCall, token: str) -> Answer:
    if not _running.acquire(blocking=False):
        raise Problem(503, "the dispatcher is slow to answer", "try again later")
    try:
        return client.call(call.method, call.path, call.body, token, WITHIN_S)
    except InputError as error:
        log.warning("the dispatcher's API: %s", error)
        mend = "look whether it runs; where the page asks it is dispatcher_api in its settings"
        raise Problem(502, f"the dispatcher gives no answer: {error.problem}", mend) from None
    finally:
        _running.release()


def _log(action: Action, remote: str, answer: Answer) -> None:
    named = answer.document.get("paused_by") or answer.document.get("acknowledged_by")
    who = f"{str(named)[:100]!r} at {remote}" if isinstance(named, str) else remote
    log.info(
        "%s of %.300a asked for by %s: %s%s",
        action.action,
        action.subject,
        who,
        "done" if answer.status < 400 else f"refused, {answer.status}",
        "" if action.reason is None else f" ({action.reason[:500]!a})",
    )


def _refusal(answer: Answer) -> Problem:
    def text(key: str) -> str | None:
        value: Any = answer.document.get(key)
        return None if value is None else str(value)

    detail, mend = text("detail") or "the dispatcher refused", text("mend")
    if answer.status == 401:
        detail, mend = "the dispatcher does not know this token", _TOKEN_MEND
    elif answer.status == 403:
        mend = "ask your administrator for a token that may"
    return Problem(answer.status, detail, mend, field=text("field"))
