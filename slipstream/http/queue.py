"""What a caller that follows a stream has not taken yet."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from typing import Generic, TypeVar

_T = TypeVar("_T")


class EventQueue(Generic[_T]):
    """A queue that is filled by any thread and taken, all at once, in the event loop of its caller.

    Classes of its kinds say how much may wait: they add to `_waiting` under `_lock`, then call
    `_notify`.

    Attributes:
        closed: nothing more will come.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.closed = False
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
