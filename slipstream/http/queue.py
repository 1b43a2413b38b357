"""What a caller that follows a stream has not taken yet, and how many streams there may be."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Collection
from typing import Any, Generic, TypeVar

from slipstream.http.problems import Problem

_T = TypeVar("_T")


class EventQueue(Generic[_T]):
    """A queue that is filled by any thread and taken, all at once, in the event loop of its caller.

    Classes of its kinds say how much may wait: they add to `_waiting` under `_lock`, then call
    `_notify`.

    Args:
        caller: whose it is, in words.

    Attributes:
        closed: nothing more will come.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, caller: str) -> None:
        self.closed = False
        self.caller = caller
        self._lock = threading.Lock()
        self._waiting: deque[_T] = deque()
        self._loop = loop
        self._woken = False
        self._wake = asyncio.Event()

    def close(self) -> None:
        """End it."""
        self.closed = True
        self._notify()

    async def take(self, within_s: float) -> list[_T]:
        """What waits, as soon as something does; empty if nothing comes in time, or it ends."""
        try:
            async with asyncio.timeout(within_s):
                await self._wake.wait()
        except TimeoutError:
            return []
        with self._lock:
            self._wake.clear()
            self._woken = False
            return self._drained()

    def _drained(self) -> list[_T]:
        """What waits, which it does not any more; the lock is held."""
        found = list(self._waiting)
        self._waiting.clear()
        return found

    def _notify(self) -> None:
        with self._lock:
            if self._woken:
                return
            self._woken = True
        try:
            self._loop.call_soon_threadsafe(self._wake.set)
        except RuntimeError:  # the loop is closed: the server went down
            self.closed = True


def check_room(streams: Collection[EventQueue[Any]], caller: str, most: int, share: int) -> None:
    """Check that one more stream may be opened.

    Args:
        streams: those that are open.
        caller: that asks for one, in words.
        most: streams of all callers.
        share: of one caller, so that nobody takes all of them.

    Raises:
        Problem: 429: the caller has its share; 503: all callers together have the most.
    """
    mend, again = "close one of them", {"Retry-After": "10"}
    if sum(stream.caller == caller for stream in streams) >= share:
        detail = f"{share} streams of {caller} are open, the most that one caller may have"
        raise Problem(429, detail, mend, headers=again)
    if len(streams) >= most:
        raise Problem(503, f"{most} streams are open, the most there may be", mend, headers=again)
