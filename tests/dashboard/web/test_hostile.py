"""A hostile browser: nothing is executed, nothing goes down, and others are still served."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack

import pytest
from starlette.requests import Request

from slipstream.http import server
from slipstream.messages import CYCLE_KEY, bare_preview_key, preview_key
from slipstream.orders import OrderRecord

SCRIPT = "<script>alert(1)</script>"


def test_requests_for_other_names_and_of_other_sites_are_refused(serve):
    """403 as a problem document, also for the stream and for files."""
    page = serve(allowed_hosts=("city.example.org",))
    for path in ("/", "/api/config", "/api/live", "/static/index.html"):
        for headers in (
            {"Host": "evil.example.org"},
            {"Host": "localhost", "Origin": "http://evil.example.org"},
            {"Host": "localhost", "Origin": "null"},
        ):
            answer = page.ask("GET", path, headers)
            assert answer.status == 403, (path, headers)
            assert answer.headers["content-type"] == "application/problem+json"
    assert page.get("/", Host="city.example.org").status == 200
    port = page.port
    own = page.ask("GET", "/", {"Host": f"127.0.0.1:{port}", "Origin": f"http://127.0.0.1:{port}"})
    assert own.status == 200


def test_every_answer_keeps_browsers_from_running_what_is_not_ours(serve):
    """A policy, no sniffing, no caching past a new version, for refusals too."""
    page = serve()
    for path in ("/", "/api/config", "/api/vehicles/none", "/nothing/here"):
        headers = page.get(path).headers
        assert "script-src 'self'" in headers["content-security-policy"]
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert "no-" in headers["cache-control"]
    assert page.get("/nothing/here").status == 404


def test_the_page_is_asked_for_without_its_body(serve):
    """As monitors do."""
    page = serve()
    head, whole = page.ask("HEAD", "/"), page.get("/")
    assert (head.status, head.body) == (200, b"")
    assert head.headers["content-length"] == str(len(whole.body))
    assert head.headers["etag"] == whole.headers["etag"]


def test_a_script_in_a_name_is_text(serve, tell, world, now_ns):
    """It comes as JSON, and only as JSON."""
    page = serve()
    tell(page, now_ns)
    page.live.on_cycle(CYCLE_KEY, world.cycle(3, now_ns).to_bytes())
    page.live.tell(
        orders=(OrderRecord(SCRIPT, SCRIPT, 60.0, 0, None, None, "open", now_ns, SCRIPT),)
    )
    page.present.update(now_ns)
    card = page.get("/api/orders/%3Cscript%3Ealert(1)%3C%2Fscript%3E")
    assert card.status == 200
    assert card.headers["content-type"] == "application/json"
    assert card.json["why"] == SCRIPT
    missing = page.get("/api/orders/%3Cimg%20src=x%20onerror=alert(1)%3E")
    assert (missing.status, missing.headers["content-type"]) == (404, "application/problem+json")
    stream = page.follow()
    assert stream.next()[1]["orders"][SCRIPT]["node"] == SCRIPT


BROKEN = (
    b"\x00" * 64,
    b"GET /api/live\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: x\r\n\r\n",
    b"POST /api/config HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999\r\n\r\n",
    b"GET /static/../../../settings.py HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /static/%2e%2e/%2e%2e/settings.py HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /api/vehicles/%ff%00 HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /api/at?t=99999999999999999999 HTTP/1.1\r\nHost: localhost\r\n\r\n",
)


def test_broken_requests_are_refused(serve, tell, now_ns):
    """Each with a status of 4xx, and the page goes on."""
    page = serve()
    tell(page, now_ns)
    page.present.update(now_ns)
    for sent in BROKEN:
        with socket.create_connection(("127.0.0.1", page.port), timeout=20) as connection:
            connection.sendall(sent)
            answer = connection.recv(4096)
        assert answer.startswith(b"HTTP/1.1 4"), (sent, answer)
    assert page.get("/api/config").status == 200


@pytest.mark.long
def test_a_thousand_connections_shut_nobody_out_for_long(serve, monkeypatch):
    """Silent ones end; meanwhile whoever follows goes on following."""
    monkeypatch.setattr(server, "HEAD_WITHIN_S", 2.0)
    page = serve()
    page.present.update(1)
    stream = page.follow()
    stream.next()
    with ExitStack() as stack:
        for _ in range(1000):
            connection = socket.socket()
            stack.callback(connection.close)
            connection.setblocking(False)
            connection.connect_ex(("127.0.0.1", page.port))
        page.present.update(2_500_000_000)
        page.hub.publish(page.present.known().moment, {"t": 1, "seq": 2, "set": {}, "del": {}})
        while stream.next()[1]["seq"] != 2:
            pass
        deadline, status = time.monotonic() + 30, 503
        while status != 200 and time.monotonic() < deadline:
            try:
                status = page.get("/api/config").status
            except OSError:
                time.sleep(0.1)
        assert status == 200


def test_no_address_takes_all_streams(serve, monkeypatch):
    """429 beyond its share; a proxy on this machine says whose browser it is, others do not."""
    from dashboard.web import hub
    from dashboard.web.routes.live import _address

    monkeypatch.setattr(hub, "MAX_VIEWERS_OF_ONE", 2)
    page = serve()
    for _ in range(2):
        page.follow()
    refused = page.get("/api/live")
    assert refused.status == 429
    assert "2 streams of the address 127.0.0.1 are open" in refused.json["detail"]
    scope = {"type": "http", "headers": [(b"x-forwarded-for", b"spoofed, 203.0.113.7")]}
    assert _address(Request({**scope, "client": ("127.0.0.1", 1)})) == "203.0.113.7"
    assert _address(Request({**scope, "client": ("203.0.113.9", 1)})) == "203.0.113.9"


@pytest.mark.slow
def test_whoever_does_not_read_is_cut_off(serve, tell, now_ns, monkeypatch):
    """And holds nobody up; its place is free again."""
    from dashboard.web.routes import live

    monkeypatch.setattr(live, "SEND_WITHIN_S", 0.5)
    page = serve()
    tell(page, now_ns)
    page.present.update(now_ns)
    slow = page.follow(gzip=False)
    slow.connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    padding = {"t": 1, "seq": 1, "set": {}, "del": {}, "text": "x" * 4_000_000}
    deadline = time.monotonic() + 30
    while page.hub.viewers and time.monotonic() < deadline:
        page.hub.publish(page.present.known().moment, padding)
        time.sleep(0.05)
    assert not page.hub.viewers


def test_pictures_are_asked_of_units_that_are_looked_at(serve, tell, world, now_ns, monkeypatch):
    """One subscription by unit for as long as somebody looks; what is no picture is refused."""
    monkeypatch.setattr("dashboard.web.pictures.GLANCE_S", 0.1)
    page = serve()
    tell(page, now_ns)
    page.present.update(now_ns)
    asked = []

    def wait_until_nobody_looks():
        deadline = time.monotonic() + 20
        while asked[-1] and time.monotonic() < deadline:
            time.sleep(0.02)

    class Listener:
        def listen(self, key_expressions):
            asked.append(key_expressions)
            for key in key_expressions:
                page.pictures.accept(key, world.jpeg(99 if key.endswith("/bare") else 150))

    page.pictures.listen_by(Listener())
    still = page.get("/api/rsus/rsu-avenue_east/still")
    assert (still.status, still.headers["content-type"]) == (200, "image/jpeg"), still.body
    assert still.body == world.jpeg(150)
    assert abs(int(still.headers["x-picture-taken"]) / 1e3 - time.time()) < 60
    wait_until_nobody_looks()
    assert asked == [frozenset(), {preview_key("rsu-avenue_east")}, frozenset()]
    bare = page.get("/api/rsus/rsu-avenue_east/still?boxes=false")
    assert bare.body == world.jpeg(99) != still.body
    wait_until_nobody_looks()
    assert asked[3:] == [{bare_preview_key("rsu-avenue_east")}, frozenset()]
    with socket.create_connection(("127.0.0.1", page.port), timeout=20) as connection:
        path = b"/api/rsus/rsu-avenue_east/picture"
        connection.sendall(b"GET " + path + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")
        received = b""
        while world.jpeg(150) not in received:
            received += connection.recv(65536)
        assert b"multipart/x-mixed-replace" in received
        assert asked[-1] == {preview_key("rsu-avenue_east")}
    wait_until_nobody_looks()
    assert asked[-1] == frozenset()
    assert page.get("/api/rsus/nobody/picture").status == 404
