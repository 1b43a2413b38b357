"""`blind`: things move (`motion`) on the road that the detector does not find."""

from __future__ import annotations

from collections import deque
from typing import ClassVar, Final

import numpy as np

from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.motion import MotionFinder, covered
from edge_daemon.watch.sample import Sample
from slipstream.messages import CameraFault

_WINDOW_S: Final = 8.0
_MIN_MISSED: Final = 12
MISSED_TO_FOUND: Final = 3


class BlindJudge(FaultJudge):
    """Counts moving things with and without a box over the last seconds; another judge updates the
    background of the motion.

    Once seen, the fault is seen until boxes cover what moves again: an empty road proves nothing.
    """

    fault: ClassVar[CameraFault] = "blind"

    def __init__(self, motion: MotionFinder) -> None:
        self._motion = motion
        self.is_blind = False
        self._counts: deque[tuple[float, int, int]] = deque()

    def look(self, sample: Sample) -> bool:
        """True if most of what moves on the road is not detected."""
        if sample.boxes is None:
            return self.is_blind
        things = self._motion.find()
        if things is None:
            return self.is_blind
        has_box = covered(things, sample.boxes.astype(np.float64))
        found = int(np.count_nonzero(has_box))
        self._counts.append((sample.time_s, found, len(has_box) - found))
        while sample.time_s - self._counts[0][0] > _WINDOW_S:
            self._counts.popleft()
        found = sum(count for _, count, _ in self._counts)
        missed = sum(count for _, _, count in self._counts)
        if missed >= _MIN_MISSED and missed > MISSED_TO_FOUND * found:
            self.is_blind = True
        elif found > missed:
            self.is_blind = False
        return self.is_blind

    def interrupt(self, by: CameraFault | None) -> None:
        """The next frame may show another scene or another light; the detector is the same."""
        self._counts.clear()
