"""Cameras on loopback for tests: HTTP MJPEG and RTSP, with the faults that real ones have."""

from __future__ import annotations

import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.frame import Frame

Picture = npt.NDArray[np.uint8]
QUALITY = 80


class Feed:
    """What a camera shows and how it sends it; tests change the attributes while it runs.

    Attributes:
        picture: the picture of each frame number.
        fps: frames a second.
        late_s: frames leave up to so much later than they were taken, at random.
        stalled: connections stay open, but nothing is sent.
        off: connections are cut, and new ones too.
    """

    def __init__(self, picture: Callable[[int], Picture], fps: float = 25.0) -> None:
        self.picture = picture
        self.fps = fps
        self.late_s = 0.0
        self.stalled = False
        self.off = False
        self._began = time.monotonic()

    def frames(self) -> Iterator[tuple[float, Picture]]:
        """(time taken, picture) at the moment each is to be sent; ends when switched off."""
        chance = random.Random(1)
        number = int((time.monotonic() - self._began) * self.fps) + 1
        while not self.off:
            taken = self._began + number / self.fps
            wait = taken + chance.uniform(0, self.late_s) - time.monotonic()
            time.sleep(max(0.0, wait))
            while self.stalled and not self.off:
                time.sleep(0.02)
                number = int((time.monotonic() - self._began) * self.fps)
            yield number / self.fps, self.picture(number)
            number += 1


_encoded: dict[int, tuple[Picture, bytes]] = {}


def jpeg(picture: Picture) -> bytes:
    """A baseline JPEG with the standard tables; made once for each array."""
    if id(picture) not in _encoded:
        _encoded[id(picture)] = (picture, _encode(picture))
    return _encoded[id(picture)][1]


def _encode(picture: Picture) -> bytes:
    ok, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert ok
    return data.tobytes()


class MjpegServer:
    """An HTTP camera that sends ``multipart/x-mixed-replace``."""

    def __init__(self, feed: Feed) -> None:
        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path == "/missing":
                    self.send_error(404)
                    return
                if self.path == "/page":
                    self.send_response(200)
                    self.send_header("Content-Type", "text/html")
                    self.end_headers()
                    self.wfile.write(b"<html><body>Please log in</body></html>" * 50)
                    return
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=f")
                self.end_headers()
                part = b"--f\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n"
                try:
                    for _, picture in feed.frames():
                        data = jpeg(picture)
                        self.wfile.write(part % len(data) + data + b"\r\n")
                except OSError:
                    return

            def log_message(self, *_: object) -> None:
                pass

        self.feed = feed
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.address = f"http://127.0.0.1:{self._server.server_port}"
        self.url = f"{self.address}/stream"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Switch it off."""
        self.feed.off = True
        self._server.shutdown()
        self._server.server_close()


class RtspServer:
    """An RTSP camera: JPEG over RTP (RFC 2435), interleaved in the TCP connection (RFC 2326)."""

    def __init__(self, feed: Feed) -> None:
        self.feed = feed
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"rtsp://127.0.0.1:{self._listener.getsockname()[1]}/stream"
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """Switch it off."""
        self.feed.off = True
        # Closing alone would leave the thread in accept.
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        with connection, connection.makefile("rb") as requests:
            try:
                while not self.feed.off and (method := self._answer(connection, requests)):
                    if method == "PLAY":
                        self._play(connection)
                        return
            except OSError:
                return

    def _answer(self, connection: socket.socket, requests: object) -> str:
        method, sequence = "", ""
        for raw in requests:  # type: ignore[attr-defined]
            line = raw.decode().strip()
            if not line:
                break
            method = method or line.split()[0]
            if line.lower().startswith("cseq:"):
                sequence = line.split(":")[1].strip()
        if not method:
            return ""
        body, extra = "", ""
        if method == "OPTIONS":
            extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=test\r\nt=0 0\r\n"
            body += "m=video 0 RTP/AVP 26\r\na=control:track1\r\n"
            extra = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            extra = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "PLAY":
            extra = "Session: 1\r\n"
        answer = f"RTSP/1.0 200 OK\r\nCSeq: {sequence}\r\n{extra}\r\n{body}"
        connection.sendall(answer.encode())
        return method

    def _play(self, connection: socket.socket) -> None:
        sequence = 0
        for taken_s, picture in self.feed.frames():
            stamp = int(90_000 * taken_s) & 0xFFFFFFFF
            for payload, last in _fragments(picture):
                head = struct.pack(">BBHII", 0x80, 26 | last << 7, sequence & 0xFFFF, stamp, 1)
                packet = head + payload
                connection.sendall(b"$\0" + struct.pack(">H", len(packet)) + packet)
                sequence += 1


def _fragments(picture: Picture) -> Iterator[tuple[bytes, bool]]:
    """RTP payloads of one picture: the JPEG's scan without its headers, which the receiver knows.

    Width and height are multiples of 16, as type 1 (4:2:0) needs them here.
    """
    data = jpeg(picture)
    start = data.index(b"\xff\xda")
    scan = data[start + 2 + struct.unpack_from(">H", data, start + 2)[0] : -2]
    height, width = picture.shape[:2]
    for offset in range(0, len(scan), 40_000):
        part = scan[offset : offset + 40_000]
        head = struct.pack(">I", offset)  # the top byte is the type-specific one, 0
        head += bytes([1, QUALITY, width // 8, height // 8])
        yield head + part, offset + len(part) >= len(scan)


def take(frames: Iterator[Frame | None], count: int, seconds: float = 60.0) -> list[Frame]:
    """The next frames that are some."""
    deadline = time.monotonic() + seconds
    got: list[Frame] = []
    while len(got) < count:
        assert time.monotonic() < deadline, "no frames came"
        frame = next(frames)
        if frame is not None:
            got.append(frame)
    return got
