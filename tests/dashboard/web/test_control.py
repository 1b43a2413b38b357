"""Actions: handed on with the caller's token, where the page may; refusals come back."""

from __future__ import annotations

import json
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from dashboard.web.routes import control
from dashboard.web.routes.actions import Action, call_of
from dispatcher_daemon.service.api import create_app
from slipstream.http.rate import RateLimit

from .conftest import Answer, Served


class Api(BaseHTTPRequestHandler):
    """Notes what it is asked, and answers as a dispatcher that knows one token."""

    asked: list[tuple[str, str, str | None, bytes]]

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        token = self.headers.get("Authorization")
        type(self).asked.append((self.command, self.path, token, body))
        status, document = 200, {"paused": True, "paused_by": "anna"}
        if token != "Bearer good":
            status, document = 401, {"detail": "unknown token", "mend": "send one"}
        elif self.path.endswith("/cancelled"):
            status = 409
            document = {"detail": "order is under way", "mend": "wait", "field": "order"}
        elif "/strict/" in self.path and b"reason" in body:
            status, document = 422, {"detail": "unknown key", "field": "reason"}
        text = json.dumps(document).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    do_DELETE = do_POST

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def api() -> Iterator[tuple[str, list[tuple[str, str, str | None, bytes]]]]:
    """Its address, and what it was asked."""
    kind = type("Noting", (Api,), {"asked": []})
    server = ThreadingHTTPServer(("127.0.0.1", 0), kind)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", kind.asked
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(autouse=True)
def no_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests are one caller."""
    monkeypatch.setattr(control, "_rate", RateLimit(1e6, 1e6))


def act(page: Served, action: object, **headers: str) -> Answer:
    """Ask for an action, with a token."""
    sent = {"Authorization": "Bearer good", "Content-Type": "application/json"} | {
        name.replace("_", "-"): value for name, value in headers.items()
    }
    return page.ask("POST", "/api/actions", sent, json.dumps(action).encode())


PAUSE = {"action": "pause", "subject": "dispatcher", "vehicle": None, "reason": "ice\non the road"}


def test_an_action_is_handed_on_and_logged(
    serve: Callable[..., Served], api: Any, caplog: pytest.LogCaptureFixture
) -> None:
    """With the caller's token, and who it was in one line."""
    address, asked = api
    page = serve(allow_control=True, dispatcher_api=address)
    with caplog.at_level(logging.INFO, "dashboard.web.routes.control"):
        answer = act(page, PAUSE)
    assert (answer.status, set(answer.json)) == (200, {"text"})
    assert asked == [
        ("POST", "/v1/control/pause", "Bearer good", b'{"reason": "ice\\non the road"}')
    ]
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith("pause of 'dispatcher' asked for by 'anna' at 127.0.0.1: done")
    assert "\n" not in line
    act(page, {"action": "pin", "subject": "order/a/b", "vehicle": "van-1"})
    assert asked[-1][1:] == ("/v1/orders/a%2Fb/pin", "Bearer good", b'{"vehicle": "van-1"}')


def test_a_page_that_only_shows_refuses(serve: Callable[..., Served], api: Any) -> None:
    """Nothing reaches the dispatcher."""
    address, asked = api
    answer = act(serve(dispatcher_api=address), PAUSE)
    assert (answer.status, answer.json["status"]) == (403, 403)
    assert asked == []


def test_refusals_pass_through(serve: Callable[..., Served], api: Any) -> None:
    """As problem documents with the dispatcher's words."""
    page = serve(allow_control=True, dispatcher_api=api[0])
    refused = act(page, {"action": "cancel", "subject": "order/cancelled"})
    assert refused.headers["content-type"] == "application/problem+json"
    assert (refused.status, refused.json["detail"], refused.json["mend"]) == (
        409,
        "order is under way",
        "wait",
    )
    unknown = act(page, PAUSE, Authorization="Bearer bad")
    assert (unknown.status, unknown.json["detail"]) == (
        401,
        "the dispatcher does not know this token",
    )
    assert "Authorization" not in unknown.json["mend"]


def test_what_is_no_action_does_not_leave_the_page(serve: Callable[..., Served], api: Any) -> None:
    """No token, a form of another site, another site's script, no JSON, too much of it."""
    address, asked = api
    page = serve(allow_control=True, dispatcher_api=address)
    assert act(page, PAUSE, Authorization="").status == 401
    assert act(page, PAUSE, Authorization="Basic eDp5").status == 401
    assert act(page, PAUSE, Content_Type="text/plain").status == 415
    assert act(page, PAUSE, Origin="http://elsewhere.example").status == 403
    assert act(page, {"action": "pause", "subject": "order/x"}).status == 422
    assert act(page, "x" * 100_000).status == 413
    json_type = {"Authorization": "Bearer good", "Content-Type": "application/json"}
    for body in (b"", b"{", b"[]", b'{"action": "pause", "action": "pause"}', b"\xff"):
        assert page.ask("POST", "/api/actions", json_type, body).status == 422, body
    assert page.get("/api/actions").status == 405
    assert asked == []


def test_a_dispatcher_that_is_away_is_told(serve: Callable[..., Served]) -> None:
    """One that does not listen."""
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{closed.getsockname()[1]}"
        answer = act(serve(allow_control=True, dispatcher_api=address), PAUSE)
    assert answer.status == 502
    assert "no answer" in answer.json["detail"]


def test_actions_are_limited(
    serve: Callable[..., Served], api: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More than a few at once are refused, before anything is sent."""
    monkeypatch.setattr(control, "_rate", RateLimit(0.001, 2.0))
    address, asked = api
    page = serve(allow_control=True, dispatcher_api=address)
    answers = [act(page, PAUSE) for _ in range(4)]
    assert [answer.status for answer in answers] == [200, 200, 429, 429]
    assert int(answers[-1].headers["retry-after"]) > 0
    assert len(asked) == 2


@pytest.mark.slow
def test_the_dispatchers_api_has_every_call() -> None:
    """Method and path of each action are operations of its description."""
    paths = create_app(None).openapi()["paths"]
    for action, subject in (
        ("pause", "dispatcher"),
        ("resume", "dispatcher"),
        ("solve", "dispatcher"),
        ("pin", "order/ORDER"),
        ("release", "order/ORDER"),
        ("cancel", "order/ORDER"),
        ("acknowledge", "alarm/ALARM"),
    ):
        call = call_of(Action.model_validate({"action": action, "subject": subject}))
        path = call.path.replace("ORDER", "{order}").replace("ALARM", "{alarm}")
        assert call.method.lower() in paths[path], call
