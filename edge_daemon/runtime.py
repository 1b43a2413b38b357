"""What delays frames: the longest time of each stage of the work."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class StageTimer:
    """The longest time spent in each stage of the work since it was last reported."""

    def __init__(self) -> None:
        self._longest_s: dict[str, float] = {}
        self._collecting_s = 0.0

    def note(self, stage: str, seconds: float) -> None:
        """Note how long a stage took once."""
        self._longest_s[stage] = max(seconds, self._longest_s.get(stage, 0.0))

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Time a stage."""
        began = time.monotonic()
        try:
            yield
        finally:
            self.note(stage, time.monotonic() - began)

    @contextmanager
    def measure_garbage_collection(self) -> Iterator[None]:
        """Time Python's garbage collections too, in any thread."""

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

    def report(self) -> str:
        """The longest time of each stage in words, longest first; starts again."""
        ranked = sorted(self._longest_s.items(), key=lambda each: -each[1])
        self._longest_s = {}
        return ", ".join(f"{stage} {1e3 * seconds:.0f} ms" for stage, seconds in ranked)
