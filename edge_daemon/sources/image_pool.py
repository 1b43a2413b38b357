"""Memory for decoded pictures, used again as soon as nobody holds the picture in it.

A picture of 720p is 2.8 MB. From the heap, one would be taken and given back for each frame, and
how much of it the allocator keeps would depend on who was late when.
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
    """Hands out pictures to decode into; for one thread."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        """Set it up.

        Args:
            shape: of the pictures, (height, width, 3).
        """
        self._shape = shape
        self._kept = [_blank(shape)]
        # What a picture that is only kept has: how many references a loop adds is Python's affair.
        self._unused = self._references()[0]

    def acquire(self) -> Image:
        """A picture that nobody else holds, nor any part of it; what it shows is left over."""
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
    """A picture in pages of its own, which go back to the system with it."""
    # Made in one step, so that parts of it hold the picture itself and not what it is a view of.
    return np.ndarray(shape, np.uint8, mmap.mmap(-1, prod(shape)))
