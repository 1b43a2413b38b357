"""The Python process of a daemon: freed memory returned to the system, and what delays frames.

glibc keeps freed memory between blocks that are in use, and Python freed tuples until a full
garbage collection, next to none of which comes after `gc.freeze`. The size of a daemon must not
depend on how long it has run.
"""

from __future__ import annotations

import ctypes
import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

TRIM_INTERVAL_S: Final = 30.0
# Parameters of mallopt in glibc's malloc.h. By default glibc raises the threshold up to 32 MB with
# what is freed, so that frames and tensors come to lie between small blocks that stay; and each
# thread gets an arena of its own, which fills again after every trim.
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8
_MMAP_THRESHOLD_BYTES: Final = 1 << 20
_ARENAS: Final = 1


def configure_allocator() -> None:
    """Give large blocks their own pages and small ones a single arena, with glibc; call before
    threads start.
    """
    if _MALLOPT is not None:
        _MALLOPT(_M_MMAP_THRESHOLD, _MMAP_THRESHOLD_BYTES)
        _MALLOPT(_M_ARENA_MAX, _ARENAS)


def trim_memory() -> None:
    """Empty Python's free lists and, with glibc, return free pages of the heap: some 2 ms where
    loaded modules are frozen.
    """
    gc.collect()
    if _TRIM is not None:
        _TRIM(0)


_TRIM: Final = getattr(ctypes.CDLL(None), "malloc_trim", None)
if _TRIM is not None:
    _TRIM.argtypes = [ctypes.c_size_t]
_MALLOPT: Final = getattr(ctypes.CDLL(None), "mallopt", None) if _TRIM is not None else None
if _MALLOPT is not None:
    _MALLOPT.argtypes = [ctypes.c_int, ctypes.c_int]


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
