"""A served page with what feeds it: the real application and tables, without a bus."""

from __future__ import annotations

import gzip
import http.client
import json
import socket
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from dashboard.live import LiveData
from dashboard.settings import DashboardSettings
from dashboard.view.places import Places
from dashboard.web.app import make_app
from dashboard.web.hub import PageHub
from dashboard.web.pictures import Pictures
from dashboard.web.routes.present import Present
from dashboard.web.services import PageServices
from dashboard.web.tables.rows import Scene
from dashboard.web.tables.tables import PageTables
from slipstream.http.server import HttpServer
from slipstream.messages import DISPATCHER_HEALTH_KEY, rsu_health_key, state_key


@dataclass
class Answer:
    """What a request was answered with."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        packed = self.headers.get("content-encoding") == "gzip"
        return json.loads(gzip.decompress(self.body) if packed else self.body)


@dataclass
class Stream:
    """The events that one browser gets."""

    connection: socket.socket
    gzip: bool
    _unpack: Any = field(default_factory=lambda: zlib.decompressobj(zlib.MAX_WBITS | 16))
    _raw: bytes = b""
    _text: bytes = b""
    received: int = 0

    def next(self, within_s: float = 20.0) -> tuple[str, Any]:
        """The next event: its kind and data."""
        deadline = time.monotonic() + within_s
        while b"\n\n" not in self._text or self._skipped():
            self.connection.settimeout(max(0.01, deadline - time.monotonic()))
            self._feed(self.connection.recv(65536))
        block, _, self._text = self._text.partition(b"\n\n")
        fields = dict(line.split(b": ", 1) for line in block.split(b"\n"))
        return fields[b"event"].decode(), json.loads(fields[b"data"])

    def _skipped(self) -> bool:
        while b"\n\n" in self._text and not self._text.startswith(b"event"):
            self._text = self._text.partition(b"\n\n")[2]
        return b"\n\n" not in self._text

    def _feed(self, data: bytes) -> None:
        assert data, "the stream ended"
        self.received += len(data)
        self._raw += data
        while b"\r\n" in self._raw:
            size, _, rest = self._raw.partition(b"\r\n")
            length = int(size, 16)
            if len(rest) < length + 2:
                return
            chunk, self._raw = rest[:length], rest[length + 2 :]
            self._text += self._unpack.decompress(chunk) if self.gzip else chunk


@dataclass
class Served:
    """The served page; `live` takes messages, `present.update` tells of them."""

    port: int
    live: LiveData
    present: Present
    hub: PageHub
    pictures: Pictures
    services: PageServices
    open_connections: list[socket.socket] = field(default_factory=list)

    def ask(
        self, method: str, path: str, headers: dict[str, str] | None = None, body: bytes = b""
    ) -> Answer:
        """Send one request."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.request(method, path, body or None, headers or {})
            answer = connection.getresponse()
            names = {name.lower(): value for name, value in answer.getheaders()}
            return Answer(answer.status, names, answer.read())
        finally:
            connection.close()

    def get(self, path: str, **headers: str) -> Answer:
        """Read; headers by their names with underscores."""
        return self.ask("GET", path, {k.replace("_", "-"): v for k, v in headers.items()})

    def follow(self, *, gzip: bool = True) -> Stream:
        """Follow the stream of events."""
        stream = follow(self.port, gzip=gzip)
        self.open_connections.append(stream.connection)
        return stream


def follow(port: int, *, gzip: bool = True) -> Stream:
    """Follow the stream of events of a page."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=20)
    accept = "Accept-Encoding: gzip\r\n" if gzip else ""
    connection.sendall(f"GET /api/live HTTP/1.1\r\nHost: localhost\r\n{accept}\r\n".encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += connection.recv(1)
    assert head.startswith(b"HTTP/1.1 200"), head
    assert (b"content-encoding: gzip" in head.lower()) == gzip
    return Stream(connection, gzip)


@pytest.fixture
def serve(world, now_ns) -> Iterator[Callable[..., Served]]:
    """Serves the page of the demo network; settings may be given."""
    stops = []

    def start(**settings: Any) -> Served:
        chosen = DashboardSettings.model_validate({"database_url": None} | settings)
        live = LiveData(lambda: now_ns)
        scene = Scene(Places(world.network), {"depot": "depot"})
        tables = PageTables(scene, stale_after_s=chosen.stale_after_s)
        hub, pictures = PageHub(), Pictures()
        present = Present(live, tables, hub, lambda: True)
        services = PageServices(chosen, scene, present.known, hub, pictures)
        server = HttpServer("the page", "127.0.0.1", 0, "port")
        server.start(make_app(services))
        served = Served(server.port, live, present, hub, pictures, services)
        stops.append(lambda: [connection.close() for connection in served.open_connections])
        stops.extend((hub.close_all, server.close))
        return served

    yield start
    for stop in stops:
        stop()


@pytest.fixture
def tell(world) -> Callable[..., None]:
    """Tells a page one second of the demo: a watched avenue, its unit, the dispatcher."""

    def one_second(page: Served, now_ns: int, speed_mps: float = 15.0) -> None:
        state = world.state("avenue_east", now_ns, speed_mps=speed_mps)
        health = world.health("avenue_east", now_ns)
        page.live.on_state(state_key(state.rsu, "avenue_east"), state.to_bytes())
        page.live.on_rsu_health(rsu_health_key(state.rsu), health.to_bytes())
        page.live.on_dispatcher_health(DISPATCHER_HEALTH_KEY, world.dispatcher(now_ns).to_bytes())

    return one_second
