"""Who may talk to the page: its own browsers, and nobody in their name; and what they may write."""

from __future__ import annotations

import gc
import gzip
import logging
import socket
import struct
import threading
import time
import urllib.request
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from typing import Any

import msgspec
import pytest
import viser
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, ConnectionClosedError, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from dashboard.page import Page
from dashboard.requests import MAX_MESSAGE_BYTES, ONE_LINE, check_names
from dashboard.server import start_server, stop_server
from dashboard.settings import DashboardSettings
from dashboard.web.pictures import Pictures
from slipstream.bus import free_port
from slipstream.config import check
from slipstream.errors import InputError
from slipstream.service import LogLimiter

PROXIED = "slipstream.example.org"
VERSION = f"viser-v{viser.__version__}"

pytestmark = pytest.mark.attack


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[viser.ViserServer]:
    """A running server behind a proxy of one name, which has written nothing yet."""
    monkeypatch.setattr("dashboard.server._SHARE_LIMITER", LogLimiter())
    monkeypatch.setattr(ONE_LINE, "_limiter", LogLimiter())
    running = start_server("127.0.0.1", free_port(), (PROXIED,))
    yield running
    stop_server(running)


def ask(port: int, *lines: str, upgrade: bool = False) -> str:
    """Status line of a request for the page, or of a websocket handshake."""
    if upgrade:
        lines += (
            *("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"),
            *("Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", f"Sec-WebSocket-Protocol: {VERSION}"),
        )
    with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
        client.sendall("\r\n".join(("GET / HTTP/1.1", *lines, "", "")).encode("latin-1"))
        return client.makefile("rb").readline().decode().strip()


def lines_of(caplog: pytest.LogCaptureFixture) -> list[str]:
    """What a journal would have."""
    return "\n".join(caplog.messages).splitlines()


def test_the_page_has_its_own_title_and_icon(server: viser.ViserServer) -> None:
    """Not viser's; compressed or not, and of the length that it states."""
    address = f"http://127.0.0.1:{server.get_port()}/"
    for encoding in ("identity", "gzip"):
        request = urllib.request.Request(address, headers={"Accept-Encoding": encoding})
        for _ in range(2):
            with urllib.request.urlopen(request, timeout=30) as answer:
                body = answer.read()
                assert int(answer.headers["Content-Length"]) == len(body)
                packed = answer.headers["Content-Encoding"] == "gzip"
            text = (gzip.decompress(body) if packed else body).decode()
            assert packed == (encoding == "gzip")
            assert "<title>Slipstream in 3D</title>" in text
            assert "<title>Viser</title>" not in text
            assert text.count("fill='%230b5cad'") == 1
            assert "%23f9e20b" not in text


def until(condition: Callable[[], bool], within_s: float = 60.0) -> bool:
    """Whether a condition comes true."""
    deadline = time.monotonic() + within_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return condition()


def becomes(status: str, server: viser.ViserServer, *, upgrade: bool = False) -> bool:
    """Whether a request is answered so, sooner or later."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        with suppress(ConnectionError):
            if ask(server.get_port(), "Host: localhost", upgrade=upgrade) == status:
                return True
        time.sleep(0.02)
    return False


def client_of(server: viser.ViserServer) -> ClientConnection:
    """A browser's connection."""
    return connect(
        f"ws://127.0.0.1:{server.get_port()}",
        subprotocols=[Subprotocol(VERSION)],
        proxy=None,
        open_timeout=60,
    )


@pytest.mark.parametrize(
    ("headers", "refused"),
    [
        ([("Host", "127.0.0.1:8080")], None),
        ([("Host", "localhost:9000"), ("Origin", "http://localhost:9000")], None),
        ([("Host", "[::1]:8080"), ("Origin", "http://[::1]:8080")], None),
        ([("Host", "LOCALHOST")], None),
        # The address that the request came in on, where 0.0.0.0 is served.
        ([("Host", "192.0.2.7:8080"), ("Origin", "http://192.0.2.7:8080")], None),
        # Behind a proxy that passes the name on, with and without a port, and one that does not.
        ([("Host", PROXIED), ("Origin", f"https://{PROXIED}")], None),
        ([("Host", PROXIED), ("Origin", f"https://{PROXIED}:8443")], None),
        ([("Host", "127.0.0.1:8080"), ("Origin", f"https://{PROXIED.upper()}")], None),
        ([], "Host"),
        ([("Host", "")], "Host"),
        ([("Host", "rebound.example")], "Host"),
        ([("Host", "rebound.example:8080"), ("Origin", "http://rebound.example:8080")], "Host"),
        ([("Host", "localhost.rebound.example")], "Host"),
        ([("Host", "localhost@rebound.example")], "Host"),
        ([("Host", "192.0.2.8")], "Host"),
        ([("Host", "localhost"), ("Host", "rebound.example")], "Host"),
        ([("Host", "localhost:8080"), ("Origin", "http://localhost:3000")], "Origin"),
        ([("Host", "127.0.0.1:8080"), ("Origin", "http://localhost:8080")], "Origin"),
        ([("Host", "localhost:8080"), ("Origin", "https://foreign.example")], "Origin"),
        ([("Host", PROXIED), ("Origin", f"https://{PROXIED}.foreign.example")], "Origin"),
        ([("Host", "localhost:8080"), ("Origin", "null")], "Origin"),
        ([("Host", "localhost:8080"), ("Origin", "")], "Origin"),
        ([("Host", "localhost"), ("Origin", "file://localhost")], "Origin"),
    ],
)
def test_requests_of_the_page_and_others(
    headers: list[tuple[str, str]], refused: str | None
) -> None:
    """Own names and addresses pass; others, missing, double and malformed ones do not."""
    asked = Headers(headers)
    hosts, origins = asked.get_all("Host"), asked.get_all("Origin")
    found = check_names(hosts, origins, "0.0.0.0", frozenset({PROXIED}), "192.0.2.7")
    assert (found and found.header) == refused


@pytest.mark.parametrize("upgrade", [False, True], ids=["page", "websocket"])
def test_a_foreign_host_or_origin_is_forbidden(server: viser.ViserServer, upgrade: bool) -> None:
    """HTTP 403 for the page and for the handshake; what is its own gets the page or the socket."""
    port = server.get_port()
    good = "HTTP/1.1 101 Switching Protocols" if upgrade else "HTTP/1.1 200 OK"
    bad = "HTTP/1.1 403 Forbidden"
    assert ask(port, f"Host: 127.0.0.1:{port}", upgrade=upgrade) == good
    assert ask(port, f"Host: {PROXIED}", f"Origin: https://{PROXIED}", upgrade=upgrade) == good
    assert ask(port, "Host: rebound.example", upgrade=upgrade) == bad
    own = f"Host: 127.0.0.1:{port}"
    assert ask(port, own, "Origin: https://foreign.example", upgrade=upgrade) == bad
    assert ask(port, own, "Host: rebound.example", upgrade=upgrade) == bad
    assert ask(port, upgrade=upgrade) == bad


def test_the_operator_reads_which_name_was_refused(
    server: viser.ViserServer, caplog: pytest.LogCaptureFixture
) -> None:
    """One line a minute with the name and the key to set, whatever the name holds."""
    with caplog.at_level(logging.INFO):
        for name in ("page.example.net", "\xff\x85", *(f"{n}.example" for n in range(50))):
            assert "403" in ask(server.get_port(), f"Host: {name}")
    (line,) = lines_of(caplog)
    assert "'page.example.net'" in line
    assert "allowed_hosts" in line


@pytest.mark.parametrize("name", ["https://page.example.net", "page.example.net:443", "a b", ""])
def test_a_name_with_scheme_or_port_is_refused_in_the_settings(name: str) -> None:
    """A name that could never match is one line at the start, not a page that nobody gets."""
    with pytest.raises(InputError, match="allowed_hosts"):
        check({"allowed_hosts": [name]}, DashboardSettings, "dashboard.toml")
    check({"allowed_hosts": [PROXIED, "192.0.2.7", "::1"]}, DashboardSettings, "dashboard.toml")


def test_a_viser_that_serves_otherwise_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the requests could not be examined, nothing is served."""
    stopped = []

    class Other:
        def __init__(self, **_: object) -> None: ...

        def stop(self) -> None:
            stopped.append(self)

    monkeypatch.setattr(viser, "ViserServer", Other)
    with pytest.raises(RuntimeError, match="unchecked"):
        start_server("127.0.0.1", free_port())
    assert len(stopped) == 1


def test_share_requests_write_one_line(
    server: viser.ViserServer,
    caplog: pytest.LogCaptureFixture,
    full_size: bool,
    figure: Callable[[str], None],
) -> None:
    """As many requests for a public tunnel as a client can send: no tunnel, at most two lines."""
    requests, calls = 20_000 if full_size else 2_000, []
    refuse = server.request_share_url

    def counted() -> None:
        calls.append(refuse())

    server.request_share_url = counted  # type: ignore[assignment,method-assign]
    message = msgspec.msgpack.encode({"type": "ShareUrlRequest"})
    began = time.monotonic()
    with caplog.at_level(logging.INFO), client_of(server) as client:
        for _ in range(requests):
            client.send(message)
        assert until(lambda: len(calls) == requests)
    minutes = 1 + int((time.monotonic() - began) / 60)
    assert set(calls) == {None}
    assert 1 <= len(lines_of(caplog)) <= 2 * minutes
    figure(f"{requests} share requests wrote {len(lines_of(caplog))} lines")


CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1, 0, 0, 0),
    "position": (0, 0, 1),
    "look_at": (0, 0, 0),
    "up_direction": (0, 1, 0),
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
}
BAD_FRAMES = [
    "text",
    b"",
    b"\xc1 no msgpack",
    msgspec.msgpack.encode([1, 2, 3]),
    msgspec.msgpack.encode({"type": "NoSuchMessage"}),
    msgspec.msgpack.encode({"type": "ShareUrlRequest", "surplus": 1}),
    msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": [], "updates": {}}),
    msgspec.msgpack.encode({**CAMERA, "image_width": "wide", "image_height": None}),
    msgspec.msgpack.encode({**CAMERA, "image_width": float("nan"), "image_height": 0}),
    msgspec.msgpack.encode({**CAMERA, "image_width": 1, "image_height": "9" * 400}),
]


@pytest.mark.slow
def test_bad_frames_write_no_traceback(
    server: viser.ViserServer,
    world: Any,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    figure: Callable[[str], None],
) -> None:
    """Frames that are no messages, or messages of nonsense: at most two lines, and it serves on."""
    monkeypatch.setattr("dashboard.page.start_server", lambda *_: server)
    settings = DashboardSettings(port=server.get_port(), database_url=None)
    page = Page(settings, world.network, threading.Event(), Pictures())
    with caplog.at_level(logging.INFO):
        for frame in BAD_FRAMES * 5:
            with client_of(server) as client:
                client.send(frame)
                try:
                    # A camera's message is answered, most others end the connection.
                    client.recv(timeout=60)
                    client.send(b"\xc1")
                    while True:
                        client.recv(timeout=60)
                except ConnectionClosed:
                    pass
        # asyncio tells of a task that failed when the task is collected.
        gc.collect()
        # The last of them were a camera's, whose connection is one all the same.
        assert page.client_connected.wait(60)
        assert until(lambda: page.clients() == 0)
    printed = "".join(capfd.readouterr())
    assert "Traceback" not in caplog.text + printed
    assert 1 <= len(lines_of(caplog)) <= 2, lines_of(caplog)
    assert ask(server.get_port(), "Host: localhost") == "HTTP/1.1 200 OK"
    figure(f"{5 * len(BAD_FRAMES)} bad frames wrote {len(lines_of(caplog))} lines")


def test_garbage_instead_of_a_request_writes_no_traceback(
    server: viser.ViserServer, caplog: pytest.LogCaptureFixture
) -> None:
    """What is no HTTP ends the connection."""
    with caplog.at_level(logging.INFO):
        for garbage in (b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n", b"GET\r\n\r\n", b"X" * 20_000):
            for _ in range(20):
                with socket.create_connection(("127.0.0.1", server.get_port()), 60) as client:
                    client.settimeout(60)
                    try:
                        client.sendall(garbage)
                        client.shutdown(socket.SHUT_WR)
                        while client.recv(4096):
                            pass
                    except ConnectionError:
                        pass
    assert "Traceback" not in caplog.text
    assert len(lines_of(caplog)) <= 2


def test_browsers_that_leave_while_they_are_answered_write_nothing(
    server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Neither at the end of a handshake nor within a file."""
    monkeypatch.setattr("dashboard.requests.MAX_BROWSERS", 1000)
    request = (
        "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        f"Sec-WebSocket-Protocol: {VERSION}\r\n\r\n"
    ).encode()
    with caplog.at_level(logging.INFO):
        for sent in (request, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n") * 50:
            with socket.create_connection(("127.0.0.1", server.get_port()), 60) as client:
                client.sendall(sent)
                # A reset at once, not a close that waits for what is on its way.
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        assert becomes("HTTP/1.1 200 OK", server)
        # What websockets writes where the reset comes just before its answer, which is rare.
        connections = logging.getLogger("dashboard.server.connections")
        connections.error("opening handshake failed", exc_info=ConnectionClosedError(None, None))
    assert lines_of(caplog) == []


def test_a_page_of_another_version_is_told_so(
    server: viser.ViserServer,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """A tab from before an upgrade is closed with the reason; not each one is printed."""
    with caplog.at_level(logging.INFO):
        for _ in range(20):
            with (
                connect(
                    f"ws://127.0.0.1:{server.get_port()}",
                    subprotocols=[Subprotocol("viser-v0.0.1")],
                    proxy=None,
                    open_timeout=60,
                ) as client,
                pytest.raises(ConnectionClosed, match="Version mismatch"),
            ):
                client.recv(timeout=60)
    assert len(lines_of(caplog)) == 1
    assert capfd.readouterr().out == ""


def test_browsers_beyond_the_most_are_refused(
    server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """503 in words, before viser hears of them; files are served, and a place that is free is."""
    monkeypatch.setattr("dashboard.requests.MAX_BROWSERS", 2)
    with client_of(server):
        with client_of(server):
            for _ in range(3):
                with pytest.raises(InvalidStatus) as caught:
                    client_of(server)
                assert caught.value.response.status_code == 503
                assert b"2 browsers follow" in caught.value.response.body
            assert ask(server.get_port(), "Host: localhost") == "HTTP/1.1 200 OK"
        assert becomes("HTTP/1.1 101 Switching Protocols", server, upgrade=True)
    assert len(lines_of(caplog)) == 1


def test_connections_beyond_the_most_are_cut_off(
    server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At once, those that send nothing too; others are served as soon as these have gone."""
    monkeypatch.setattr("dashboard.requests.MAX_CONNECTIONS", 4)
    address = ("127.0.0.1", server.get_port())
    with ExitStack() as stack:
        for _ in range(4):
            stack.enter_context(socket.create_connection(address, 60))
        with socket.create_connection(address, 60) as beyond, suppress(ConnectionError):
            assert beyond.recv(1) == b""
    assert becomes("HTTP/1.1 200 OK", server)


def test_a_message_that_no_browser_sends_ends_its_connection(server: viser.ViserServer) -> None:
    """Too large a one; what waits for viser is bounded so."""
    with client_of(server) as client:
        client.send(b"x" * (MAX_MESSAGE_BYTES + 1))
        with pytest.raises(ConnectionClosed, match="1009"):
            deque(client, maxlen=0)


def test_a_foreign_handshake_ends_in_the_client(server: viser.ViserServer) -> None:
    """A real websocket client with a foreign Origin gets 403."""
    with pytest.raises(InvalidStatus) as caught:
        connect(
            f"ws://127.0.0.1:{server.get_port()}",
            origin=Origin("https://foreign.example"),
            subprotocols=[Subprotocol(VERSION)],
            proxy=None,
            open_timeout=60,
        )
    assert caught.value.response.status_code == 403
