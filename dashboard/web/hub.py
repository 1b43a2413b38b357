"""What changes, on its way from the daemon to each browser: encoded and compressed once for all.

A compressed part ends on a whole byte and refers to nothing before it (zlib's full flush), so that
the same bytes fit into the stream of any browser.
"""

from __future__ import annotations

import asyncio
import json
import threading
import zlib
from typing import Any, Final

from slipstream.http.queue import EventQueue, check_room

MAX_VIEWERS: Final = 64
MAX_VIEWERS_OF_ONE: Final = 32
"""Of one address: an office behind one of them has some browsers, and all of them never."""
MAX_WAITING: Final = 8
"""Deltas that a viewer may have ahead of it; beyond, a new moment takes their place."""
_LEVEL: Final = 5
"""Half the processor time of zlib's default, 6, for 1 % more bytes."""
GZIP_HEAD: Final = b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\xff"
"""Begin of a compressed stream."""


def event(kind: str, data: object) -> bytes:
    """One server-sent event."""
    # JSON has no line ends of its own.
    return b"event: " + kind.encode() + b"\ndata: " + encoded(data) + b"\n\n"


def encoded(data: object) -> bytes:
    """Compact JSON; what is not finite, which JSON has not, is refused."""
    return json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode(
        "utf-8", "replace"
    )


def packed(part: bytes) -> bytes:
    """A part of a gzip stream."""
    deflate = zlib.compressobj(_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    return deflate.compress(part) + deflate.flush(zlib.Z_FULL_FLUSH)


class HubPart:
    """An event, as text and compressed."""

    def __init__(self, plain: bytes, *, compress: bool = True) -> None:
        self.plain = plain
        self.gzip = packed(plain) if compress else b""

    def of(self, gzip: bool) -> bytes:
        """As a viewer reads it."""
        return self.gzip if gzip else self.plain


HEARTBEAT: Final = HubPart(b": heartbeat\n\n")


class PageViewer(EventQueue[HubPart]):
    """What one browser has not taken yet."""

    def put(self, part: HubPart) -> bool:
        """Add one; False: too many wait, and it is left out."""
        with self._lock:
            if len(self._waiting) >= MAX_WAITING:
                return False
            self._waiting.append(part)
        self._notify()
        return True

    def replace(self, part: HubPart) -> None:
        """Put one in place of all that wait."""
        with self._lock:
            self._waiting.clear()
            self._waiting.append(part)
        self._notify()


class PageHub:
    """Passes moments and deltas on to browsers; safe for threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._viewers: set[PageViewer] = set()
        self._moment: dict[str, Any] | None = None
        self._encoded: tuple[int, HubPart] | None = None
        self.connected = threading.Event()
        """Set when a browser comes; the owner clears it."""

    @property
    def viewers(self) -> int:
        """Number of browsers that follow."""
        return len(self._viewers)

    @property
    def moment(self) -> dict[str, Any] | None:
        """The latest; None before the first."""
        return self._moment

    def publish(self, moment: dict[str, Any], delta: dict[str, Any] | None) -> int:
        """Tell all that follow.

        Returns:
            The bytes of the compressed delta.
        """
        with self._lock:
            self._moment = moment
            self._viewers = {viewer for viewer in self._viewers if not viewer.closed}
            if delta is None or not self._viewers:
                return 0
            part = HubPart(event("delta", delta))
            for viewer in self._viewers:
                if not viewer.put(part):
                    viewer.replace(self._whole())
            return len(part.gzip)

    def open(self, caller: str) -> PageViewer:
        """A new viewer in the running event loop, the moment first.

        Args:
            caller: whose browser it is, in words.

        Raises:
            Problem: there are too many, of this caller or of all.
        """
        viewer = PageViewer(asyncio.get_running_loop(), caller)
        with self._lock:
            self._viewers = {known for known in self._viewers if not known.closed}
            check_room(self._viewers, caller, MAX_VIEWERS, MAX_VIEWERS_OF_ONE)
            if self._moment is not None:
                viewer.put(self._whole())
            self._viewers.add(viewer)
        self.connected.set()
        return viewer

    def close(self, viewer: PageViewer) -> None:
        """End one."""
        viewer.close()
        with self._lock:
            self._viewers.discard(viewer)

    def close_all(self) -> None:
        """End all."""
        with self._lock:
            for viewer in self._viewers:
                viewer.close()
            self._viewers = set()

    def _whole(self) -> HubPart:
        assert self._moment is not None
        number = self._moment["seq"]
        if self._encoded is None or self._encoded[0] != number:
            self._encoded = number, HubPart(event("moment", self._moment))
        return self._encoded[1]
