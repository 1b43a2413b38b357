"""Memory of a daemon's process: what was freed goes back to the system.

glibc keeps freed memory between blocks that are in use, and Python freed tuples and objects in
circles until a full garbage collection, next to none of which comes after `gc.freeze`. The size of
a daemon must not depend on how long it has run.
"""

from __future__ import annotations

import ctypes
import gc
from typing import Final

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


def collect_garbage_less() -> None:
    """Have garbage be looked for seldom; call before all else is loaded, which is none.

    Full collections stop all threads for tenths of a second, and young ones after every 700 objects
    take a tenth of a start, and a third of the time of reading a second's messages: some ten
    thousand objects without circles.
    """
    gc.set_threshold(50_000, 20, 50)


def keep_loaded() -> None:
    """No collection looks through what is loaded by now."""
    gc.collect()
    gc.freeze()


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
