"""`camera_moved`: the view has shifted or turned against the calibrated one, or shakes by more than
is taken out (`view`).
"""

from __future__ import annotations

from collections import deque
from typing import ClassVar, Final

import numpy as np

from edge_daemon.camera import Array
from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Sample, sharpness, small_of, texture
from edge_daemon.watch.view import LOST_SHARE, View
from slipstream.messages import CameraFault

_LONG_ENOUGH: Final = 0.7


class CameraMovedJudge(FaultJudge):
    """Looks at where the road lies in a view that is measured frame by frame.

    Args:
        max_shift_px: in the median over `median_s`.
        max_shake_px: about that median, in the median.

    Attributes:
        view: the caller measures each frame in it, this judge tells it what can be seen.
        sharpness: of the calibrated view; None while that is not known.
    """

    fault: ClassVar[CameraFault] = "camera_moved"

    def __init__(
        self, view: View, max_shift_px: float, max_shake_px: float, median_s: float
    ) -> None:
        self.view = view
        self._max_shift_px = max_shift_px
        self._max_shake_px = max_shake_px
        self._median_s = median_s
        self._seen: deque[tuple[float, float, Array | None]] = deque()
        self._recent = False
        self._moved = False
        self.sharpness: float | None = None
        self._find_sharpness()

    def look(self, sample: Sample) -> bool:
        """True if the view had shifted, or shaken, when it was last examined."""
        view = self.view
        if sample.shows_view:
            view.learn(sample.time_s, sample.detail)
            if self.sharpness is None:
                self._find_sharpness()
        if view.calibrated is None:
            return False
        if self._recent != view.is_recent:
            self._recent = view.is_recent
            self._seen.clear()
        self._seen.append((sample.time_s, view.found_share, view.displacement()))
        while sample.time_s - self._seen[0][0] > self._median_s:
            self._seen.popleft()
        if sample.shows_view and sample.time_s - self._seen[0][0] >= _LONG_ENOUGH * self._median_s:
            self._moved = self._judge()
        return self._moved

    def interrupt(self, by: CameraFault | None) -> None:
        """The view is measured across other faults that hide the scene for a moment."""
        if by in (None, "obscured"):
            self._seen.clear()
            self._moved = False
            self.view.restart()

    def _find_sharpness(self) -> None:
        if self.view.calibrated is not None:
            small = small_of(self.view.calibrated)
            self.sharpness = sharpness(small, texture(small))

    def _judge(self) -> bool:
        if self.view.is_bare:
            return False  # nothing in this view could be recognised in the first place
        if np.median([share for _, share, _ in self._seen]) < 1 - LOST_SHARE:
            self.detail = "the view is not recognised"
            return True
        rows = np.stack([at for _, _, at in self._seen if at is not None])
        middle = np.median(rows, axis=0)
        shift = float(np.linalg.norm(middle, axis=1).max())
        shakes = np.linalg.norm(rows - middle, axis=2).max(axis=1)
        shake = float(np.median(shakes))
        for found, what, limit in (
            (shift, "shifted", self._max_shift_px),
            (shake, "shakes", self._max_shake_px),
        ):
            if found > limit:
                self.detail = f"the road {what} by {found:.1f} px, limit {limit:.1f}"
                return True
        return False
