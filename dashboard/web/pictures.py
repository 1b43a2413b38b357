"""Camera pictures, asked only of those roadside units that somebody looks at."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Final, Protocol
from urllib.parse import unquote

from slipstream.errors import InputError
from slipstream.messages import preview_key

MAX_PICTURE_BYTES: Final = 512 * 1024
MAX_KEPT: Final = 64
"""Latest pictures that are kept, of as many units."""
MAX_LOOKS: Final = 64
"""Streams of pictures at once."""
KEPT_S: Final = 3.0
"""A picture is shown as the latest for so long."""
GLANCE_S: Final = 5.0
"""Whoever asks for single pictures is taken to look on for so long after each."""


class Listener(Protocol):
    """Subscriptions that change; see `slipstream.subscriptions.Listener`."""

    def listen(self, key_expressions: frozenset[str]) -> None:
        """Receive these keys, and no others."""
        ...


class Pictures:
    """The latest picture of each unit that is looked at; safe for threads.

    Units draw and send pictures only while somebody subscribes to theirs, so each one is subscribed
    to on its own, and for as long as it is looked at.

    Args:
        clock_s: a monotonic clock.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._clock_s = clock_s
        self._lock = threading.Lock()
        self._looks: Counter[str] = Counter()
        self._latest: OrderedDict[str, tuple[bytes, float]] = OrderedDict()
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
        rsu = rsu_of(key)
        check_jpeg(key, payload)
        with self._lock:
            self._latest[rsu] = payload, self._clock_s()
            self._latest.move_to_end(rsu)
            if len(self._latest) > MAX_KEPT:
                self._latest.popitem(last=False)
            waiting = tuple(self._waiting.get(rsu, ()))
        for loop, event in waiting:
            with contextlib.suppress(RuntimeError):  # the loop is closed: the server went down
                loop.call_soon_threadsafe(event.set)

    def latest(self, rsu: str) -> bytes | None:
        """The latest picture of a unit; None: there is none of the last `KEPT_S`."""
        with self._lock:
            jpeg, at_s = self._latest.get(rsu, (b"", 0.0))
        return jpeg if jpeg and self._clock_s() - at_s <= KEPT_S else None

    @contextlib.contextmanager
    def looking(self, rsu: str) -> Iterator[bool]:
        """While the block runs, the unit is asked for pictures; False: too many are looked at."""
        with self._lock:
            taken = sum(self._looks.values()) < MAX_LOOKS
            if taken:
                self._looks[rsu] += 1
        self._ask()
        try:
            yield taken
        finally:
            if taken:
                with self._lock:
                    self._looks[rsu] -= 1
                    if not self._looks[rsu]:
                        del self._looks[rsu]
                self._ask()

    def glance(self, rsu: str) -> None:
        """Ask the unit for pictures for `GLANCE_S` from now on; call it in the server's loop."""
        if rsu in self._glances:
            timer, look = self._glances[rsu]
            timer.cancel()
        else:
            look = contextlib.ExitStack()
            if not look.enter_context(self.looking(rsu)):
                return

        def end() -> None:
            del self._glances[rsu]
            look.close()

        self._glances[rsu] = asyncio.get_running_loop().call_later(GLANCE_S, end), look

    async def following(self, rsu: str, within_s: float) -> AsyncIterator[bytes]:
        """The pictures of a unit as they come; one that is not taken in time is left out.

        Args:
            rsu: the unit.
            within_s: ends where none comes for so long.
        """
        loop, event = asyncio.get_running_loop(), asyncio.Event()
        with self._lock:
            self._waiting.setdefault(rsu, set()).add((loop, event))
        shown = None
        try:
            while True:
                jpeg = self.latest(rsu)
                if jpeg is not None and jpeg is not shown:
                    shown = jpeg
                    yield jpeg
                try:
                    async with asyncio.timeout(within_s):
                        await event.wait()
                except TimeoutError:
                    return
                event.clear()
        finally:
            with self._lock:
                self._waiting[rsu].discard((loop, event))
                if not self._waiting[rsu]:
                    del self._waiting[rsu]

    def _ask(self) -> None:
        with self._change:
            if self._listener is not None:
                self._listener.listen(self._keys())

    def _keys(self) -> frozenset[str]:
        with self._lock:
            return frozenset(map(preview_key, self._looks))


def rsu_of(key: str) -> str:
    """The unit that a key of pictures names.

    Raises:
        InputError: it is no such key.
    """
    rsu = unquote(key.split("/")[3]) if key.count("/") == 4 else ""
    if key != preview_key(rsu):
        raise InputError(key, f"its message belongs under {preview_key(rsu)}", "check the sender")
    return rsu


def check_jpeg(key: str, payload: bytes) -> None:
    """Check that a payload is a JPEG of bounded size.

    Raises:
        InputError: it is not.
    """
    if not (payload.startswith(b"\xff\xd8\xff") and payload.endswith(b"\xff\xd9")):
        raise InputError(key, "not a JPEG picture", "check the sender's version")
    if len(payload) > MAX_PICTURE_BYTES:
        raise InputError(key, f"picture of {len(payload)} bytes", "send smaller previews")
