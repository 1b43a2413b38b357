"""Memory that was freed goes back to the system, and the heap keeps one shape.

glibc keeps freed memory amid what is still in use, and what it keeps only grows, by less and less:
0.8 MB over 15,000 frames, while what is in use stays the same. So does Python: freed tuples go to
lists of up to 2000 of each length, which only a full garbage collection empties, and after
`gc.freeze` there is next to none by itself. A daemon's size shall not depend on how long it has
run.
"""

from __future__ import annotations

import ctypes
import gc
from typing import Final

GIVE_BACK_EVERY_S: Final = 30.0
# glibc's malloc.h. By itself glibc moves the bound up to 32 MB with what is freed, so that pictures
# and tensors come to lie between small things that stay; and each thread gets a heap of its own,
# which fills again after every trim.
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8
_OWN_PAGES_FROM_BYTES: Final = 1 << 20
_ARENAS: Final = 1


def keep_shape() -> None:
    """Large blocks get pages of their own for good, small ones one heap; call before threads start.

    Elsewhere than on glibc: nothing.
    """
    if _MALLOPT is not None:
        _MALLOPT(_M_MMAP_THRESHOLD, _OWN_PAGES_FROM_BYTES)
        _MALLOPT(_M_ARENA_MAX, _ARENAS)


def give_back_freed() -> None:
    """Empty Python's free lists and hand free pages of the heap back; elsewhere the first alone.

    Takes some 2 ms where what was loaded is frozen.
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
