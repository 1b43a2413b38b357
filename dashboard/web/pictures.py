"""Camera pictures, asked only of those roadside units that somebody looks at."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import dataclass
from typing import Final
from urllib.parse import unquote

from slipstream.bus.subscriptions import Listener
from slipstream.errors import InputError
from slipstream.messages import bare_preview_key, capture_time_ns, preview_key

MAX_PICTURE_BYTES: Final = 512 * 1024
MAX_KEPT: Final = 64
"""Latest pictures that are kept, each of its key."""
MAX_LOOKS: Final = 64
"""Streams of pictures at once."""
KEPT_S: Final = 3.0
"""A picture is the latest for so long after it came."""
GLANCE_S: Final = 5.0
"""Whoever asks for single pictures is taken to look on for so long after each."""


@dataclass(frozen=True)
class Picture:
    """One picture of a camera.

    Attributes:
        jpeg: of it.
        taken_ns: UTC at which it was taken, as its unit says: one whose camera has stopped sends
            its last picture again. Of a unit that does not say it, when it came.
    """

    jpeg: bytes
    taken_ns: int


class Pictures:
    """The latest picture of each unit that is looked at; safe for threads.

    Units draw and send pictures only while somebody subscribes to theirs, so each one is subscribed
    to on its own, and for as long as it is looked at.
    """

    def __init__(
        self,
        clock_s: Callable[[], float] = time.monotonic,
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._clock_s, self._clock_ns = clock_s, clock_ns
        self._lock = threading.Lock()
        self._looks: Counter[str] = Counter()
        self._latest: OrderedDict[str, tuple[Picture, float]] = OrderedDict()
        self._waiting: dict[str, set[tuple[asyncio.AbstractEventLoop, asyncio.Event]]] = {}
        self._glances: dict[str, tuple[asyncio.TimerHandle, contextlib.ExitStack]] = {}
        self._listener: Listener | None = None
        self._change = threading.Lock()

    def listen_by(self, listener: Listener | None) -> None:
        """Set what receives them; None: nothing does any more."""
        with self._change:
            self._listener = listener
            if listener is not None:
                listener.listen(self._keys())

    def accept(self, key: str, payload: bytes) -> None:
        """Take in a picture: a JPEG of at most `MAX_PICTURE_BYTES`.

        Raises:
            InputError: it is none, or too large.
        """
        check_key(key)
        check_jpeg(key, payload)
        picture = Picture(payload, capture_time_ns(payload) or self._clock_ns())
        with self._lock:
            self._latest[key] = picture, self._clock_s()
            self._latest.move_to_end(key)
            if len(self._latest) > MAX_KEPT:
                self._latest.popitem(last=False)
            waiting = tuple(self._waiting.get(key, ()))
        for loop, event in waiting:
            with contextlib.suppress(RuntimeError):  # the loop is closed: the server went down
                loop.call_soon_threadsafe(event.set)

    def latest(self, key: str) -> Picture | None:
        """The latest picture of a key; None: none came in the last `KEPT_S`."""
        with self._lock:
            picture, at_s = self._latest.get(key, (None, 0.0))
        return picture if self._clock_s() - at_s <= KEPT_S else None

    @contextlib.contextmanager
    def looking(self, key: str) -> Iterator[bool]:
        """While the block runs, a unit is asked for the pictures of a key (`picture_key`); False:
        too many are looked at.
        """
        with self._lock:
            taken = sum(self._looks.values()) < MAX_LOOKS
            if taken:
                self._looks[key] += 1
        self._ask()
        try:
            yield taken
        finally:
            if taken:
                with self._lock:
                    self._looks[key] -= 1
                    if not self._looks[key]:
                        del self._looks[key]
                self._ask()

    def glance(self, key: str) -> None:
        """Ask for pictures of a key for `GLANCE_S` from now on; call it in the server's loop."""
        if key in self._glances:
            timer, look = self._glances[key]
            timer.cancel()
        else:
            look = contextlib.ExitStack()
            if not look.enter_context(self.looking(key)):
                return

        def end() -> None:
            del self._glances[key]
            look.close()

        self._glances[key] = asyncio.get_running_loop().call_later(GLANCE_S, end), look

    async def following(self, key: str, within_s: float) -> AsyncIterator[Picture]:
        """The pictures of a key as they come; one that is not taken in time is left out."""
        loop, event = asyncio.get_running_loop(), asyncio.Event()
        with self._lock:
            self._waiting.setdefault(key, set()).add((loop, event))
        shown = None
        try:
            while True:
                picture = self.latest(key)
                if picture is not None and picture is not shown:
                    shown = picture
                    yield picture
                try:
                    async with asyncio.timeout(within_s):
                        await event.wait()
                except TimeoutError:
                    return
                event.clear()
        finally:
            with self._lock:
                self._waiting[key].discard((loop, event))
                if not self._waiting[key]:
                    del self._waiting[key]

    def _ask(self) -> None:
        with self._change:
            if self._listener is not None:
                self._listener.listen(self._keys())

    def _keys(self) -> frozenset[str]:
        with self._lock:
            return frozenset(self._looks)


def picture_key(rsu: str, *, boxes: bool) -> str:
    """Key of a unit's pictures, with the boxes that it draws or without."""
    return preview_key(rsu) if boxes else bare_preview_key(rsu)


def check_key(key: str) -> None:
    """Check that a key is one of pictures.

    Raises:
        InputError: it is not.
    """
    chunks = key.split("/")
    rsu = unquote(chunks[3]) if len(chunks) in (5, 6) else ""
    if key not in (preview_key(rsu), bare_preview_key(rsu)):
        raise InputError(key, f"its message belongs under {preview_key(rsu)}", "check the sender")


def check_jpeg(key: str, payload: bytes) -> None:
    """Check that a payload is a JPEG of bounded size.

    Raises:
        InputError: it is not.
    """
    if not (payload.startswith(b"\xff\xd8\xff") and payload.endswith(b"\xff\xd9")):
        raise InputError(key, "not a JPEG picture", "check the sender's version")
    if len(payload) > MAX_PICTURE_BYTES:
        raise InputError(key, f"picture of {len(payload)} bytes", "send smaller previews")
