"""Labels on an image that do not overlap, and tinted polygons."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import cv2
import numpy as np

from edge_daemon.camera.homography import Array
from edge_daemon.frame import Image

Colour = tuple[int, int, int]
"""Blue, green, red, 0 to 255."""

WHITE: Final[Colour] = (255, 255, 255)
DARK: Final[Colour] = (45, 38, 30)
_PAD: Final = 3
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX


class Labels:
    """Places labels on one image, none over another; `draw` puts them over all else."""

    def __init__(self, picture: Image) -> None:
        self._picture = picture
        self._placed: list[tuple[str, tuple[int, int], float, int, Colour]] = []
        self._backgrounds: list[Colour] = []
        self._taken: list[tuple[int, int, int, int]] = []

    def put(
        self,
        text: str,
        places: Iterable[tuple[float, float]],
        scale: float,
        *,
        background: Colour = DARK,
        colour: Colour = WHITE,
    ) -> bool:
        """Place an ASCII text at the first of some lower left corners, px, that is free and inside
        the image; False if there was no room. A scale of 1.0 is some 22 px high.
        """
        thickness = max(1, round(1.8 * scale))
        (width, height), below = cv2.getTextSize(text, _FONT, scale, thickness)
        rows, columns = self._picture.shape[:2]
        for place in places:
            x, y = round(place[0]), round(place[1])
            x = min(max(x, _PAD), columns - width - _PAD)
            left, right = x - _PAD, x + width + _PAD
            top, bottom = y - height - _PAD, y + below
            if top < 0 or bottom > rows or left < 0 or not self._free(left, top, right, bottom):
                continue
            self._taken.append((left, top, right, bottom))
            self._placed.append((text, (x, y), scale, thickness, colour))
            self._backgrounds.append(background)
            return True
        return False

    def draw(self) -> None:
        """Draw what was placed."""
        for (left, top, right, bottom), colour in zip(self._taken, self._backgrounds, strict=True):
            cv2.rectangle(self._picture, (left, top), (right, bottom), colour, cv2.FILLED)
        for text, at, scale, thickness, colour in self._placed:
            cv2.putText(self._picture, text, at, _FONT, scale, colour, thickness, cv2.LINE_AA)

    def _free(self, left: int, top: int, right: int, bottom: int) -> bool:
        return all(
            right <= x0 or left >= x1 or bottom <= y0 or top >= y1 for x0, y0, x1, y1 in self._taken
        )


def tint(picture: Image, outline: Array, colour: Colour, strength: float) -> None:
    """Lay a colour over a polygon (n, 2), px, in place; only the pixels round it are touched."""
    rows, columns = picture.shape[:2]
    x0, y0 = np.clip(np.floor(outline.min(axis=0)).astype(int), 0, (columns, rows))
    x1, y1 = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 1, 0, (columns, rows))
    if x0 >= x1 or y0 >= y1:
        return
    part = picture[y0:y1, x0:x1]
    over = part.copy()
    cv2.fillPoly(over, [(outline - (x0, y0)).round().astype(np.int32)], colour)
    cv2.addWeighted(over, strength, part, 1 - strength, 0, dst=part)
