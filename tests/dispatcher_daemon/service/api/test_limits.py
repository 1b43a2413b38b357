from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon import metrics
from dispatcher_daemon.service.api import ApiServer, RateLimit, guard
from slipstream.errors import InputError
from slipstream.http import bodies, server
from tests.dispatcher_daemon.service.waiting import wait_for

from .asgi import Answer
from .conftest import Api

MONKEY = pytest.MonkeyPatch


def _has_ended(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) == b""
    except ConnectionResetError:
        return True


def _raw(api: Api, sent: bytes) -> Answer:
    """What a connection that sends just this is answered with, until it is closed."""
    with socket.create_connection(("127.0.0.1", api.port), timeout=30) as connection:
        connection.sendall(sent)
        answer = http.client.HTTPResponse(connection)
        answer.begin()
        names = {name.lower(): value for name, value in answer.getheaders()}
        return Answer(answer.status, names, answer.read())


@pytest.mark.slow
def test_bodies_that_are_too_large_are_refused_before_they_are_read(
    serve: Callable[..., Api],
) -> None:
    """413 at once for a declared size of 100 MB, and for chunks that never end."""
    api = serve(tokens=True, sockets=True)
    head = b"POST /v1/solve HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer controller\r\n"
    declared = _raw(api, head + b"Content-Length: 100000000\r\n\r\n")
    assert (declared.status, declared.json["status"]) == (413, 413)
    # No byte more than it takes: the answer would be lost with what was still to be sent.
    chunk = b"%x\r\n" % 10**9 + b"1" * (guard.LARGE_BODIES["/v1/solve"] + 1)
    chunked = _raw(api, head + b"Transfer-Encoding: chunked\r\n\r\n" + chunk)
    assert (chunked.status, chunked.json["status"]) == (413, 413)
    assert api.get("/healthz").status == 200


def test_a_body_costs_nothing_before_its_sender_is_known(serve: Callable[..., Api]) -> None:
    """401 although the body has not come."""
    answer = _raw(serve(sockets=True), b"POST /v1/solve HTTP/1.1\r\nContent-Length: 9\r\n\r\n")
    # Without a Host it is no HTTP/1.1.
    assert answer.status == 400
    head = b"POST /v1/solve HTTP/1.1\r\nHost: x\r\n"
    answer = _raw(serve(sockets=True), head + b"Content-Length: 9\r\n\r\n")
    assert answer.status == 401


def test_a_body_that_does_not_come_ends_the_request(
    serve: Callable[..., Api], monkeypatch: MONKEY
) -> None:
    """408 after the time that a body has."""
    monkeypatch.setattr(bodies, "BODY_WITHIN_S", 0.2)
    head = b"POST /v1/solve HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer controller\r\n"
    answer = _raw(serve(tokens=True, sockets=True), head + b"Content-Length: 9\r\n\r\n{")
    assert (answer.status, answer.json["status"]) == (408, 408)


BODIES: list[tuple[bytes, str | None, int, str]] = [
    (b"{}", "text/plain", 415, "text/plain"),
    (b"{}", None, 415, "not given"),
    (b"{", "application/json", 400, "not JSON"),
    (b"\xff", "application/json", 400, "not JSON"),
    (b"[" * 100_000, "application/json", 400, "nested"),
    (b'{"a": 1, "a": 2}', "application/json", 400, "twice"),
    (b"[]", "application/json; charset=utf-8", 422, ""),
    (b'{"depots": [], "what": 1}', "application/json", 422, "unknown key"),
]


def test_a_body_that_is_none_of_ours_is_refused(serve: Callable[..., Api]) -> None:
    """With 415 for another type, 400 for what is no JSON, 422 for what is no fleet."""
    api = serve(tokens=True)
    for body, kind, status, said in BODIES:
        headers = {} if kind is None else {"Content-Type": kind}
        answer = api.ask("POST", "/v1/solve", "controller", body, headers)
        assert answer.status == status, body[:20]
        assert said in answer.json["detail"], body[:20]


def test_a_caller_that_asks_too_often_waits(serve: Callable[..., Api]) -> None:
    """429 with the time to wait, for its token alone."""
    api = serve(tokens=True, rate=RateLimit(rate_per_s=0.001, burst=2.0))
    assert [api.get("/v1/vehicles", "reader").status for _ in range(3)] == [200, 200, 429]
    refused = api.get("/v1/vehicles", "reader")
    assert int(refused.headers["retry-after"]) > 100
    assert api.get("/v1/solve/x", "controller").status == 404
    assert api.get("/healthz").status == 200


@pytest.mark.slow
def test_connections_are_bounded_and_silent_ones_end(
    serve: Callable[..., Api], monkeypatch: MONKEY
) -> None:
    """503 beyond the limit; those that send nothing make room again."""
    monkeypatch.setattr(server, "MAX_CONNECTIONS", 3)
    monkeypatch.setattr(server, "HEAD_WITHIN_S", 1.0)
    api = serve(sockets=True)
    silent = [socket.create_connection(("127.0.0.1", api.port), timeout=30) for _ in range(3)]
    silent[0].sendall(b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Slow: ")
    try:
        assert wait_for(lambda: api.get("/healthz").status == 503)
        assert wait_for(lambda: api.get("/healthz").status == 200)
        assert all(map(_has_ended, silent))
    finally:
        for connection in silent:
            connection.close()


def test_a_taken_port_is_bad_input() -> None:
    """The line names the address and the key."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(InputError, match=r"api\.port: cannot serve the API"):
            ApiServer(taken.getsockname()[1])


def test_an_api_that_goes_down_comes_back(
    serve: Callable[..., Api], monkeypatch: MONKEY, caplog: pytest.LogCaptureFixture
) -> None:
    """It is logged and counted, and the same port is served again."""
    monkeypatch.setattr(server, "RESTART_AFTER_S", 0.1)
    run, faults = server.uvicorn.Server.run, [1]

    def fail_once(self: Any, sockets: list[socket.socket]) -> None:
        if faults:
            faults.clear()
            raise RuntimeError("the loop broke")
        run(self, sockets)

    monkeypatch.setattr(server.uvicorn.Server, "run", fail_once)
    before = metrics.API_FAILURES._value.get()
    api = serve(sockets=True)

    def answers() -> bool:
        try:
            return api.get("/healthz").status == 200
        except OSError:
            return False

    assert wait_for(answers)
    assert metrics.API_FAILURES._value.get() == before + 1
    assert any("the loop broke" in record.message for record in caplog.records)


def test_what_is_no_http_is_answered(serve: Callable[..., Api]) -> None:
    """400 as a problem document."""
    answer = _raw(serve(sockets=True), b"hello\r\n\r\n")
    assert (answer.status, answer.headers["content-type"]) == (400, "application/problem+json")
    assert json.loads(answer.body)["title"] == "Bad Request"


def test_rates_allow_bursts_and_then_the_rate() -> None:
    """A full bucket is used up, and fills by the rate, up to its size."""
    rate = RateLimit(rate_per_s=2.0, burst=3.0)
    assert [rate.wait_s("a", 10.0) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]
    assert rate.wait_s("b", 10.0) == 0.0
    assert [rate.wait_s("a", 10.5), rate.wait_s("a", 10.5)] == [0.0, 0.5]
    assert [rate.wait_s("a", 99.0) for _ in range(4)] == [0.0, 0.0, 0.0, 0.5]
