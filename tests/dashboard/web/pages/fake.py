"""A server that speaks docs/page.md over a made-up city, for tests of the page without a daemon."""

from __future__ import annotations

import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import parse_qs, unquote, urlsplit

import cv2
import numpy as np

from tests.dashboard.web.pages import city

STATIC = Path(__file__).parents[4] / "dashboard" / "web" / "static"
TYPES = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
}
POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
HEARTBEAT_S = 1.0
TOKEN = "operator"


class FakePage:
    """Serves the static files and a city that the test changes by `send`.

    Args:
        moment: what is shown first.
        net: its network.
        config: what differs from the usual configuration.
    """

    def __init__(self, net: city.Row, moment: city.Row, **config: object) -> None:
        self.net = json.dumps(net).encode()
        self.moment = moment
        self.config: city.Row = {
            "version": "0.1.0",
            "title": "Troy",
            "control": True,
            "scene_url": "http://127.0.0.1:8081/",
            "units": "metric",
            "time_zone": "UTC",
            "co2_kg_per_kwh": 0.38,
            "price_per_kwh": 0.31,
            "currency": "EUR",
            "live": True,
            "history": True,
            **config,
        }
        self.past: dict[str, int | None] = {"first": city.T0 - city.DAY, "last": city.T0}
        self.silent = threading.Event()
        self.taken: int | None = None
        """UTC at which its pictures were taken, ms; None: now."""
        self.actions: list[city.Row] = []
        self.asked: list[str] = []
        self.streams = 0
        self._listeners: list[list[bytes]] = []
        self._lock = threading.Condition()
        self._server: ThreadingHTTPServer | None = None
        self.port = 0

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}/"

    def __enter__(self) -> Self:
        self.up()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.down()

    def up(self) -> None:
        """Listens, on the port of before if there was one."""

        class Handler(_Handler):
            page = self

        self._server = _Server(("127.0.0.1", self.port), Handler)
        self.port = self._server.server_address[1]
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def down(self) -> None:
        """Closes the port and every stream."""
        server, self._server = self._server, None
        if server is None:
            return
        with self._lock:
            self._listeners.clear()
            self._lock.notify_all()
        server.shutdown()
        server.server_close()

    def send(self, **delta: Any) -> None:
        """Changes the city, and tells all viewers: `set`, `delete`, and fields of the moment."""
        removed = delta.pop("delete", {})
        self.moment["t"] += 1000
        for table, rows in delta.get("set", {}).items():
            for key, fields in rows.items():
                self.moment[table].setdefault(key, {}).update(fields)
        for table, keys in removed.items():
            for key in keys:
                del self.moment[table][key]
        self.moment.update({key: value for key, value in delta.items() if key != "set"})
        self._push("delta", {"t": self.moment["t"], "seq": 2, "del": removed, "set": {}, **delta})

    def _push(self, event: str, value: city.Row) -> None:
        text = f"event: {event}\ndata: {json.dumps(value)}\n\n".encode()
        with self._lock:
            for queue in self._listeners:
                queue.append(text)
            self._lock.notify_all()

    def listen(self) -> list[bytes]:
        """A queue of what a viewer gets; the moment first."""
        with self._lock:
            first = f"event: moment\ndata: {json.dumps(self.moment)}\n\n".encode()
            queue = [first]
            self._listeners.append(queue)
            return queue

    def take(self, queue: list[bytes]) -> bytes | None:
        """What a viewer gets next, a heartbeat if nothing; None once the server is down."""
        with self._lock:
            if not queue:
                self._lock.wait(HEARTBEAT_S)
            if not any(one is queue for one in self._listeners):
                return None
            found = b"".join(queue)
            queue.clear()
            return found or b": alive\n\n"


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 64

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser may close a connection whenever it likes."""


class _Handler(BaseHTTPRequestHandler):
    page: FakePage
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: object) -> None:
        """Says nothing."""

    def do_GET(self) -> None:
        address = urlsplit(self.path)
        self.page.asked.append(self.path)
        parts = [unquote(part) for part in address.path.strip("/").split("/")]
        query = {key: values[0] for key, values in parse_qs(address.query).items()}
        if parts[0] in ("", "static"):
            return self._file("/".join(parts[1:]) or "index.html")
        if parts[0] == "report":
            return self._send(200, "text/html", f"<title>Report {query['day']}</title>".encode())
        if parts[0] != "api":
            return self._problem(404, "There is no such page.")
        return self._api(parts[1:], query)

    def _api(self, parts: list[str], query: dict[str, str]) -> None:
        match parts:
            case ["config"]:
                self._json(self.page.config)
            case ["network"]:
                self._send(200, "application/json", self.page.net)
            case ["live"]:
                self._live()
            case ["past"]:
                self._json(self.page.past)
            case ["at"]:
                self._json(past_moment(self.page.moment, int(query["t"])))
            case ["energy"]:
                begin, end = int(query["from"]), int(query["until"])
                self._json({"rows": city.energy_rows(query["by"], begin, end)})
            case ["export", name]:
                self._send(200, "text/csv", f"id\n{name}\n".encode())
            case ["rsus", _, "still"]:
                taken = self.page.taken and {"X-Picture-Taken": str(self.page.taken)}
                self._send(200, "image/jpeg", picture(), taken or {})
            case ["rsus", _, "picture"]:
                self._pictures()
            case [table, key]:
                t = int(query.get("t", self.page.moment["t"]))
                found = city.card(table, key, self.page.moment[table].get(key), t)
                self._json(found) if found else self._problem(404, f"There is no {key}.")
            case _:
                self._problem(404, "There is no such answer.")

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.path.startswith("/api/export/"):
            self._send(200, "text/csv", "\n".join(["id", *body["ids"]]).encode())
            return
        if self.headers["Authorization"] != f"Bearer {TOKEN}":
            self._problem(401, "The token is not known.", "Ask the administrator for one.")
            return
        self.page.actions.append(body)
        self._json({"text": f"Done: {body['action']} of {body['subject']}."})

    def _live(self) -> None:
        self._head("text/event-stream")
        queue = self.page.listen()
        self.page.streams += 1
        while (data := self.page.take(queue)) is not None:
            if not self.page.silent.is_set():
                self.wfile.write(data)
                self.wfile.flush()

    def _pictures(self) -> None:
        self._head("multipart/x-mixed-replace; boundary=frame")
        jpeg = picture()
        while self.page._server is not None:
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            self.wfile.write(head.encode() + jpeg + b"\r\n")
            time.sleep(0.5)

    def _head(self, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True

    def _file(self, name: str) -> None:
        path = (STATIC / name).resolve()
        if not path.is_relative_to(STATIC) or not path.is_file():
            self._problem(404, "There is no such file.")
            return
        self._send(200, TYPES[path.suffix], path.read_bytes())

    def _json(self, value: object) -> None:
        self._send(200, "application/json", json.dumps(value).encode())

    def _problem(self, status: int, detail: str, mend: str | None = None) -> None:
        value = {"title": "Refused", "detail": detail, "mend": mend}
        self._send(status, "application/problem+json", json.dumps(value).encode())

    def _send(
        self, status: int, kind: str, body: bytes, headers: dict[str, str] | None = None
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8" if kind[:5] == "text/" else kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)


def past_moment(moment: city.Row, t: int) -> city.Row:
    """The city of the past: the vans' texts say when."""
    vehicles = {
        key: {**row, "text": f"as of {t}", "level": "ok"} for key, row in moment["vehicles"].items()
    }
    return {**moment, "t": t, "live": False, "vehicles": vehicles}


def picture() -> bytes:
    """A picture of a road, JPEG."""
    image = np.full((270, 480, 3), (96, 104, 98), np.uint8)
    cv2.fillPoly(image, [np.array([[200, 60], [280, 60], [470, 270], [10, 270]])], (64, 62, 60))
    cv2.line(image, (240, 60), (240, 270), (220, 220, 220), 2)
    ok, jpeg = cv2.imencode(".jpg", image)
    assert ok
    return jpeg.tobytes()
