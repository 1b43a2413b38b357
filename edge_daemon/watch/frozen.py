"""`frozen`: the same frame again and again.

A sensor's noise changes every pixel a little from frame to frame, on an empty road too. A repeated
frame changes nothing, or, encoded again, some pixels by a level or two.
"""

from __future__ import annotations

from collections import deque
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from edge_daemon.watch.sample import Mask, Sample
from slipstream.messages import CameraFault

_STILL_LEVELS: Final = 0.12
_MOVED_LEVELS: Final = 12
_MOVED_SHARE: Final = 0.002
_MIN_STILL_SHARE: Final = 0.75
_MIN_ROAD_SHARE: Final = 0.03
_MIN_FRAMES: Final = 4


class FrozenJudge:
    """Compares sampled pixels of the road with those of the sample before."""

    fault: ClassVar[CameraFault] = "frozen"
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = False

    def __init__(self, still_s: float, road: Mask) -> None:
        """Set it up.

        Args:
            still_s: without any change for so long the frame is frozen, s.
            road: which of the sampled pixels show the road. The rest is left out, as a clock drawn
                into the frame may go on; all count where little of the frame is road.
        """
        self.after_s = 0.0
        self._still_s = still_s
        self._road = road if road.mean() >= _MIN_ROAD_SHARE else np.ones_like(road)
        self._last: npt.NDArray[np.int16] | None = None
        self._still: deque[tuple[float, bool]] = deque()

    def look(self, sample: Sample) -> bool:
        """True if the road has not changed for `still_s`."""
        time_s = sample.time_s
        pixels = sample.grey[self._road].astype(np.int16)
        last, self._last = self._last, pixels
        if last is None:
            return False
        change = np.abs(pixels - last)
        if np.count_nonzero(change > _MOVED_LEVELS) > _MOVED_SHARE * change.size:
            self._still.clear()
            return False
        self._still.append((time_s, bool(change.mean() < _STILL_LEVELS)))
        began = self._still[0][0]
        while len(self._still) > 1 and self._still[1][0] <= time_s - self._still_s:
            self._still.popleft()
        # A key frame changes many pixels a little even where the scene is frozen.
        still = sum(is_still for _, is_still in self._still)
        long_enough = time_s - began >= self._still_s and len(self._still) >= _MIN_FRAMES
        return long_enough and still >= _MIN_STILL_SHARE * len(self._still)

    def interrupt(self, by: CameraFault | None) -> None:
        """The next frame has no predecessor."""
        self._last = None
        self._still.clear()
