"""A pool of memory for decoded frames: if each were allocated and freed on the heap, the memory
that the allocator keeps would depend on thread timing.
"""

from __future__ import annotations

import mmap
from math import prod
from sys import getrefcount
from typing import Final

import numpy as np

from edge_daemon.frame import Image

_MAX_KEPT: Final = 6


class ImagePool:
    """Arrays (height, width, 3) to decode frames into; for one thread."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._kept = [_blank(shape)]
        # References of an array that only the pool holds; what a loop adds depends on Python.
        self._unused = self._references()[0]

    def acquire(self) -> Image:
        """An array that nothing else references, nor any view of it; its content is arbitrary."""
        for place, references in enumerate(self._references()):
            if references == self._unused:
                return self._kept[place]
        picture = _blank(self._shape)
        if len(self._kept) < _MAX_KEPT:
            self._kept.append(picture)
        return picture

    def _references(self) -> list[int]:
        return [getrefcount(picture) for picture in self._kept]


def _blank(shape: tuple[int, ...]) -> Image:
    """An array in memory pages of its own, which are returned to the system with it."""
    # Made in one step, so that views of it reference the array itself and not its base.
    return np.ndarray(shape, np.uint8, mmap.mmap(-1, prod(shape)))
