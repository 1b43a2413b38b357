"""A camera's pictures over HTTP: multipart MJPEG, each picture with the time it was taken."""

from __future__ import annotations

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final

_BOUNDARY: Final = b"slipstream"
_DEAD_CLIENT_S: Final = 5.0
_WAIT_S: Final = 1.0


class LatestPicture:
    """The newest JPEG; a slow reader gets the newest and misses those between."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._number = 0
        self._jpeg = b""
        self._taken_s = 0.0
        self._closed = False

    def put(self, jpeg: bytes, taken_s: float) -> None:
        """Show a picture, taken at a time in s since 1970."""
        with self._changed:
            self._number, self._jpeg, self._taken_s = self._number + 1, jpeg, taken_s
            self._changed.notify_all()

    def close(self) -> None:
        """There will be no more: readers are let go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def after(self, number: int, timeout_s: float = _WAIT_S) -> tuple[int, bytes, float] | None:
        """The newest picture (number, JPEG, time taken) if newer than ``number``; waits for one.
        Raises EOFError: there will be no more.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._number > number, timeout_s)
            if self._closed:
                raise EOFError
            if self._number <= number:
                return None
            return self._number, self._jpeg, self._taken_s


class MjpegServer:
    """Serves one camera on loopback: ``/`` is the stream, ``/picture.jpg`` the newest picture.

    Each client has a thread of its own, and one that does not read is dropped after 5 s, so that
    none holds up the pictures.
    """

    def __init__(self, latest: LatestPicture) -> None:
        class Handler(BaseHTTPRequestHandler):
            timeout = _DEAD_CLIENT_S

            def do_GET(self) -> None:
                try:
                    if self.path == "/":
                        _stream(self, latest)
                    elif self.path == "/picture.jpg":
                        _single(self, latest)
                    else:
                        self.send_error(404)
                except (OSError, EOFError):
                    self.close_connection = True

            def log_message(self, *_: object) -> None:
                """Say nothing: a camera has no log."""

        self._latest = latest
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Let all clients go and free the port."""
        self._latest.close()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def _stream(handler: BaseHTTPRequestHandler, latest: LatestPicture) -> None:
    handler.send_response(200)
    handler.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY.decode()}")
    handler.send_header("Cache-Control", "no-store")
    handler.end_headers()
    number = 0
    while True:
        picture = latest.after(number)
        if picture is None:
            continue
        number, jpeg, taken_s = picture
        head = (
            b"--%s\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\nX-Timestamp: %.6f\r\n\r\n"
        )
        handler.wfile.write(head % (_BOUNDARY, len(jpeg), taken_s) + jpeg + b"\r\n")


def _single(handler: BaseHTTPRequestHandler, latest: LatestPicture) -> None:
    until_s = time.monotonic() + _DEAD_CLIENT_S
    while (picture := latest.after(0)) is None:
        if time.monotonic() > until_s:
            handler.send_error(503)
            return
    handler.send_response(200)
    handler.send_header("Content-Type", "image/jpeg")
    handler.send_header("Content-Length", str(len(picture[1])))
    handler.end_headers()
    handler.wfile.write(picture[1])
