"""Where a frame's way takes longest: what to say when frames had to be skipped."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class Pauses:
    """The longest time spent in each part of the work since it was last asked for."""

    def __init__(self) -> None:
        self._longest_s: dict[str, float] = {}
        self._collecting_s = 0.0

    def note(self, part: str, seconds: float) -> None:
        """Note how long a part took once."""
        self._longest_s[part] = max(seconds, self._longest_s.get(part, 0.0))

    @contextmanager
    def of(self, part: str) -> Iterator[None]:
        """Time a part."""
        began = time.monotonic()
        try:
            yield
        finally:
            self.note(part, time.monotonic() - began)

    @contextmanager
    def of_garbage_collector(self) -> Iterator[None]:
        """Time Python's collections too, in whichever thread."""

        def notice(phase: str, _: dict[str, Any]) -> None:
            if phase == "start":
                self._collecting_s = time.monotonic()
            else:
                self.note("garbage collection", time.monotonic() - self._collecting_s)

        gc.callbacks.append(notice)
        try:
            yield
        finally:
            gc.callbacks.remove(notice)

    def told(self) -> str:
        """The longest of each part, longest first, in words; forgets them."""
        ranked = sorted(self._longest_s.items(), key=lambda each: -each[1])
        self._longest_s = {}
        return ", ".join(f"{part} {1e3 * seconds:.0f} ms" for part, seconds in ranked)
