"""`obscured`: the lens is covered, fogged or out of focus."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from statistics import median
from typing import ClassVar, Final

import cv2
import numpy as np

from edge_daemon.watch.faults.exposure import EXPOSURE_AFTER_S
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Grey, Sample, sharpness
from slipstream.messages import CameraFault

_EDGE_LEVELS: Final = 12
_MIN_EDGE_SHARE: Final = 0.01
_MIN_SHARPNESS: Final = 0.5
_MIN_OF_RECENT: Final = 0.7
"""Light and weather take longer to change as much. At 0.65 a third of the vehicles is not found."""
_RECENT_S: Final = 300.0
_MIN_RECENT: Final = 8


class ObscuredJudge(FaultJudge):
    """Looks for frames without detail, or less sharp than the calibrated or the recent view;
    `usual_sharpness` gives that of the calibrated one, None while unknown.
    """

    fault: ClassVar[CameraFault] = "obscured"
    hides_scene: ClassVar[bool] = True
    after_s: ClassVar[float] = EXPOSURE_AFTER_S

    def __init__(self, usual_sharpness: Callable[[], float | None]) -> None:
        self._usual_sharpness = usual_sharpness
        self._obscured = False
        self._recent: deque[tuple[float, float]] = deque()

    def look(self, sample: Sample) -> bool:
        """True if the view was obscured when it was last examined."""
        if sample.shows_view:
            self._obscured = self._is_obscured(sample)
        return self._obscured

    def interrupt(self, by: CameraFault | None) -> None:
        """After a cut the view may be another one."""
        if by is None:
            self._recent.clear()
            self._obscured = False

    def _is_obscured(self, sample: Sample) -> bool:
        if edge_share(sample.small) < _MIN_EDGE_SHARE:
            return True
        usual = self._usual_sharpness()
        sharp = sharpness(sample.small, sample.texture)
        if usual is not None and sharp < _MIN_SHARPNESS * usual:
            return True
        return self._is_sudden(sample.time_s, sharp)

    def _is_sudden(self, time_s: float, sharp: float) -> bool:
        recent = self._recent
        if recent and not 0 <= time_s - recent[-1][0] <= _RECENT_S:
            recent.clear()  # a night mode, or other settings: this is how the view is now
        elif len(recent) >= _MIN_RECENT and sharp < _MIN_OF_RECENT * median(s for _, s in recent):
            return True
        recent.append((time_s, sharp))
        while time_s - recent[0][0] > _RECENT_S:
            recent.popleft()
        return False


def edge_share(small: Grey) -> float:
    """Share of the pixels of a small grey image that lie on an edge, in [0, 1]."""
    kernel = np.ones((3, 3), np.uint8)
    edges = cv2.morphologyEx(small, cv2.MORPH_GRADIENT, kernel)
    return float(np.count_nonzero(edges > _EDGE_LEVELS)) / small.size
