"""What moves in the picture, by a background model alone, and which of it lies in a detector's
boxes.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera
from edge_daemon.detection import box_feet
from edge_daemon.watch.background import Background
from edge_daemon.watch.sample import Mask

_MAX_MOVING_SHARE: Final = 0.5
"""More of the road changes at once by light or exposure only."""
_CAR_WIDTH_M: Final = 1.8
_MIN_WIDTH_PX: Final = 6.0
_AREA: Final = (0.15, 15.0)
"""Of a vehicle in the picture, as multiples of a car's width squared."""
_MIN_CHANGED: Final = 0.1
_MIN_COVERED: Final = 0.3
_BOX_MARGIN: Final = 0.15


class MotionFinder:
    """Finds moving things of a vehicle's size in the small grey pictures of one view.

    Args:
        background: of the view; the caller updates it before each `find`.
        road: where to look in the small grey picture.
        zoom: width of the small grey picture over that of the frame.
        camera: tells how large a vehicle is in the picture; without one, anything counts from the
            size on that a car needs to count, up to a quarter of the picture.
    """

    def __init__(
        self, background: Background, road: Mask, zoom: float, camera: Camera | None
    ) -> None:
        self._background = background
        self._road = road
        self._zoom = zoom
        self._camera = camera

    def find(self) -> Array | None:
        """Boxes around moving things, px of the frame, shape (n, 4); None while it is learned."""
        moving, changed = self._background.foreground, self._background.changed
        if moving is None or changed is None:
            return None
        return self._boxes(moving & self._road, changed)

    def _boxes(self, moving: Mask, differs: Mask) -> Array:
        if np.count_nonzero(moving) > _MAX_MOVING_SHARE * np.count_nonzero(self._road):
            return np.empty((0, 4))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(
            moving.astype(np.uint8), connectivity=8
        )
        changed = np.bincount(labels[differs], minlength=count)[1:]
        left, top, width, height, area = np.asarray(stats[1:], dtype=np.float64).T
        rows, columns = self._road.shape
        whole = (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
        boxes = np.column_stack([left, top, left + width, top + height])[whole] / self._zoom
        # What lies there, or a decoder left behind, does not move.
        moves = changed[whole] >= _MIN_CHANGED * area[whole]
        return np.asarray(boxes[moves & self._fits(boxes, area[whole])])

    def _fits(self, boxes: Array, area: Array) -> npt.NDArray[np.bool_]:
        """Which boxes (n, 4) of things with such areas in the small picture may be vehicles."""
        if self._camera is None:
            largest = self._road.size / 4
            return np.asarray((area >= _MIN_WIDTH_PX**2 * _AREA[0]) & (area <= largest))
        across_m = np.linalg.norm(self._camera.jacobian(box_feet(boxes))[:, :, 0], axis=1)
        car_px = self._zoom * _CAR_WIDTH_M / across_m
        size = area / car_px**2
        return np.asarray((car_px >= _MIN_WIDTH_PX) & (size >= _AREA[0]) & (size <= _AREA[1]))


def covering(things: Array, boxes: Array) -> Array:
    """Which share of things (n, 4) lies in which of the boxes (m, 4), made larger, shape (n, m)."""
    margin = _BOX_MARGIN * (boxes[:, 2:] - boxes[:, :2])
    low = np.maximum(things[:, None, :2], boxes[None, :, :2] - margin)
    high = np.minimum(things[:, None, 2:], boxes[None, :, 2:] + margin)
    both = np.prod(np.clip(high - low, 0.0, None), axis=2)
    return np.asarray(both / np.prod(things[:, 2:] - things[:, :2], axis=1)[:, None])


def covered(things: Array, boxes: Array) -> npt.NDArray[np.bool_]:
    """Which things (n, 4) lie in the boxes (m, 4) with a good part of their area, shape (n,)."""
    return np.asarray(covering(things, boxes).sum(axis=1) > _MIN_COVERED)
