"""`blind`: things move on the road that the detector does not find.

Night, rain, fog or weights that were trained on another world leave a road that looks empty and is
not. What moves is told by a background model of the picture alone and held against the detector's
boxes.
"""

from __future__ import annotations

from collections import deque
from typing import ClassVar, Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera
from edge_daemon.watch.background import Background
from edge_daemon.watch.sample import Mask, Sample
from slipstream.messages import CameraFault

_MAX_MOVING_SHARE: Final = 0.5
"""More of the road changes at once by light or exposure only."""
_CAR_WIDTH_M: Final = 1.8
_MIN_WIDTH_PX: Final = 6.0
_AREA: Final = (0.15, 15.0)
"""Of a vehicle in the picture, as multiples of a car's width squared."""
_MIN_CHANGED: Final = 0.1
_MIN_COVERED: Final = 0.3
_BOX_MARGIN: Final = 0.15
_WINDOW_S: Final = 8.0
_MIN_MISSED: Final = 12
_MISSED_TO_FOUND: Final = 3


class BlindJudge:
    """Counts moving things with and without a box over the last seconds.

    Once seen, the fault is seen until boxes cover what moves again: an empty road proves nothing.

    Attributes:
        is_blind: what it said last.
    """

    fault: ClassVar[CameraFault] = "blind"
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = False

    def __init__(self, camera: Camera, road: Mask, background: Background) -> None:
        """Set it up.

        Args:
            camera: what the frames show.
            road: where vehicles drive in the small grey image.
            background: of the same road; another judge takes the samples in.
        """
        self.after_s = 0.0
        self._camera = camera
        self._road = road
        self._zoom = road.shape[1] / camera.size[0]
        self._background = background
        self.is_blind = False
        self._counts: deque[tuple[float, int, int]] = deque()

    def look(self, sample: Sample) -> bool:
        """True if most of what moves on the road is not detected."""
        moving = self._background.foreground
        if sample.boxes is None or moving is None:
            return self.is_blind
        covered = _covered(self._find(moving & self._road), sample.boxes.astype(np.float64))
        found = int(np.count_nonzero(covered))
        self._counts.append((sample.time_s, found, len(covered) - found))
        while sample.time_s - self._counts[0][0] > _WINDOW_S:
            self._counts.popleft()
        found = sum(count for _, count, _ in self._counts)
        missed = sum(count for _, _, count in self._counts)
        if missed >= _MIN_MISSED and missed > _MISSED_TO_FOUND * found:
            self.is_blind = True
        elif found > missed:
            self.is_blind = False
        return self.is_blind

    def interrupt(self, by: CameraFault | None) -> None:
        """The next frame may show another scene or another light; the detector is the same."""
        self._counts.clear()

    def _find(self, moving: Mask) -> Array:
        """Boxes around moving things of a vehicle's size, px, shape (n, 4)."""
        if np.count_nonzero(moving) > _MAX_MOVING_SHARE * np.count_nonzero(self._road):
            return np.empty((0, 4))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(
            moving.astype(np.uint8), connectivity=8
        )
        changed = np.bincount(labels[self._background.changed], minlength=count)[1:]
        left, top, width, height, area = np.asarray(stats[1:], dtype=np.float64).T
        rows, columns = self._road.shape
        whole = (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
        boxes = np.column_stack([left, top, left + width, top + height])[whole] / self._zoom
        feet = np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]])
        across_m = np.linalg.norm(self._camera.jacobian(feet)[:, :, 0], axis=1)
        car_px = self._zoom * _CAR_WIDTH_M / across_m
        size = area[whole] / car_px**2
        fits = (car_px >= _MIN_WIDTH_PX) & (size >= _AREA[0]) & (size <= _AREA[1])
        # What lies there, or a decoder left behind, does not move.
        return np.asarray(boxes[fits & (changed[whole] >= _MIN_CHANGED * area[whole])])


def _covered(things: Array, boxes: Array) -> npt.NDArray[np.bool_]:
    """Which things (n, 4) lie in the boxes (m, 4) with a good part of their area, shape (n,)."""
    margin = _BOX_MARGIN * (boxes[:, 2:] - boxes[:, :2])
    low = np.maximum(things[:, None, :2], boxes[None, :, :2] - margin)
    high = np.minimum(things[:, None, 2:], boxes[None, :, 2:] + margin)
    both = np.prod(np.clip(high - low, 0.0, None), axis=2).sum(axis=1)
    return np.asarray(both > _MIN_COVERED * np.prod(things[:, 2:] - things[:, :2], axis=1))
