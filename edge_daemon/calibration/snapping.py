"""Clicks moved to the corner or dash end that they mean."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from edge_daemon.frame import Image

_WINDOW_PX: Final = 4
_MAX_MOVE_PX: Final = 4.0
_MIN_CONTRAST: Final = 12.0


def snap(picture: Image, u: float, v: float) -> tuple[float, float]:
    """The corner near a click, to a fraction of a pixel; the click where there is none.

    Pixels count from the top left corner of the picture, so that the middle of the first pixel is
    at (0.5, 0.5). `cv2.cornerSubPix` (Förstner's operator) finds where the gradients' lines meet.
    """
    rows, columns = picture.shape[:2]
    reach = _WINDOW_PX + 3
    x, y = round(u - 0.5), round(v - 0.5)
    if not (reach < x < columns - reach and reach < y < rows - reach):
        return u, v
    part = cv2.cvtColor(
        picture[y - reach : y + reach + 1, x - reach : x + reach + 1], cv2.COLOR_BGR2GRAY
    )
    if float(part.max()) - float(part.min()) < _MIN_CONTRAST:
        return u, v
    offset = np.array([x - reach + 0.5, y - reach + 0.5])
    start = np.array([[[u, v]]], dtype=np.float32) - offset.astype(np.float32)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 0.005)
    found = cv2.cornerSubPix(part, start, (_WINDOW_PX, _WINDOW_PX), (-1, -1), criteria)
    there = np.asarray(found, dtype=np.float64).reshape(2) + offset
    if not np.isfinite(there).all() or np.hypot(*(there - (u, v))) > _MAX_MOVE_PX:
        return u, v
    return float(there[0]), float(there[1])
