"""`obscured`: the lens is covered, fogged or out of focus."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Final

import cv2
import numpy as np

from edge_daemon.watch.sample import Grey, Sample, sharpness
from slipstream.messages import CameraFault

_EDGE_LEVELS: Final = 12
_MIN_EDGE_SHARE: Final = 0.01
_MIN_SHARPNESS: Final = 0.5


class ObscuredJudge:
    """Looks for frames without detail, or much less sharp than the calibrated view."""

    fault: ClassVar[CameraFault] = "obscured"
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = True

    def __init__(self, after_s: float, usual_sharpness: Callable[[], float | None]) -> None:
        """Set it up.

        Args:
            after_s: evidence without a break for so long begins the fault, s.
            usual_sharpness: gives the `sharpness` of the calibrated view, None while unknown.
        """
        self.after_s = after_s
        self._usual_sharpness = usual_sharpness
        self._obscured = False

    def look(self, sample: Sample) -> bool:
        """True if the view was obscured when it was last examined."""
        if sample.shows_view:
            self._obscured = self._is_obscured(sample)
        return self._obscured

    def interrupt(self, by: CameraFault | None) -> None:
        """Each examined frame is judged by itself."""

    def _is_obscured(self, sample: Sample) -> bool:
        if edge_share(sample.small) < _MIN_EDGE_SHARE:
            return True
        usual = self._usual_sharpness()
        return usual is not None and (
            sharpness(sample.small, sample.texture) < _MIN_SHARPNESS * usual
        )


def edge_share(small: Grey) -> float:
    """Share of the pixels of a small grey image that lie on an edge, in [0, 1]."""
    kernel = np.ones((3, 3), np.uint8)
    edges = cv2.morphologyEx(small, cv2.MORPH_GRADIENT, kernel)
    return float(np.count_nonzero(edges > _EDGE_LEVELS)) / small.size
