"""The calibration page: a small web server on loopback, for one person.

The standard library's server is enough for one page with a handful of questions. Whoever asks must
know the key in the printed URL, and must have asked for this host by its loopback name.
"""

from __future__ import annotations

import hmac
import json
import logging
import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import cv2

from edge_daemon.calibration.session import Session
from slipstream.errors import InputError

log = logging.getLogger(__name__)

_TYPES: Final = {"html": "text/html", "js": "text/javascript", "css": "text/css"}
_JSON: Final = "application/json"
_MAX_QUESTION_BYTES: Final = 1_000_000
_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'"
)


class PageServer(ThreadingHTTPServer):
    """Serves one session at `url`, which has its key."""

    daemon_threads = True

    def __init__(self, session: Session) -> None:
        """Listen on a free port of 127.0.0.1."""
        super().__init__(("127.0.0.1", 0), _Handler)
        self.session = session
        self.key = secrets.token_urlsafe(16)
        self.url = f"http://127.0.0.1:{self.server_port}/?key={self.key}"
        _, data = cv2.imencode(".png", session.picture)
        self.picture = data.tobytes()
        files = resources.files("edge_daemon.calibration") / "static"
        self.files = {
            f"/{name}": (files / name).read_bytes() for name in ("page.html", "page.js", "page.css")
        }

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that went away before it was answered is no fault."""
        log.debug("a question was not answered", exc_info=True)


def _content(answer: dict[str, Any]) -> bytes:
    return json.dumps(answer, allow_nan=False).encode()


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """The page, its files and the picture."""
        parts = urlsplit(self.path)
        path = "/page.html" if parts.path == "/" else parts.path
        if not self._is_local():
            return
        if path in self.server.files:
            kind = _TYPES[path.rpartition(".")[2]]
            self._answer(HTTPStatus.OK, f"{kind}; charset=utf-8", self.server.files[path])
        elif path in ("/picture.png", "/begin"):
            if not self._has_key(parse_qs(parts.query).get("key", [""])[0]):
                return
            if path == "/begin":
                self._json(HTTPStatus.OK, self.server.session.begin())
            else:
                self._answer(HTTPStatus.OK, "image/png", self.server.picture)
        else:
            self._json(HTTPStatus.NOT_FOUND, {"problem": "no such page"})

    def do_POST(self) -> None:
        """One question, JSON in and out."""
        if not self._is_local() or not self._has_key(self.headers.get("X-Key", "")):
            return
        ask = self.server.session.answers().get(urlsplit(self.path).path[1:])
        length = self.headers.get("Content-Length", "")
        if ask is None or not length.isdigit() or int(length) > _MAX_QUESTION_BYTES:
            self.close_connection = True
            self._json(HTTPStatus.BAD_REQUEST, {"problem": "no such question"})
            return
        try:
            question = json.loads(self.rfile.read(int(length)))
            content = _content(ask(question))
        except InputError as error:
            content = _content({"problem": str(error)})
        except (ValueError, KeyError, TypeError, AttributeError):
            self._json(HTTPStatus.BAD_REQUEST, {"problem": "not a question of this page"})
            return
        except Exception:
            log.exception("a question could not be answered")
            told = {"problem": "this could not be worked out: the log of this command says why"}
            self._json(HTTPStatus.INTERNAL_SERVER_ERROR, told)
            return
        self._answer(HTTPStatus.OK, _JSON, content)

    def _is_local(self) -> bool:
        """Refuses what another site's name leads here (DNS rebinding)."""
        port = self.server.server_port
        if self.headers.get("Host") in (f"127.0.0.1:{port}", f"localhost:{port}"):
            return True
        self.close_connection = True
        self._json(HTTPStatus.FORBIDDEN, {"problem": "this page is for this machine only"})
        return False

    def _has_key(self, key: str) -> bool:
        if hmac.compare_digest(key.encode(), self.server.key.encode()):
            return True
        self.close_connection = True
        self._json(HTTPStatus.FORBIDDEN, {"problem": "open the page by the URL that was printed"})
        return False

    def _json(self, status: HTTPStatus, content: dict[str, Any]) -> None:
        self._answer(status, _JSON, _content(content))

    def _answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Content-Security-Policy", _POLICY)
        self.end_headers()
        self.wfile.write(content)

    def log_error(self, format: str, *args: object) -> None:
        """As all else."""

    def log_message(self, format: str, *args: object) -> None:
        """To the log, not to the terminal; no key."""
        log.debug("%s %s", self.command, urlsplit(self.path).path)
