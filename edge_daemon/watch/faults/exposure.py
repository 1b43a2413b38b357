"""`dark` and `bright`: frames that are black or white."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from edge_daemon.watch.judge import FaultJudge
from edge_daemon.watch.sample import Sample
from slipstream.messages import CameraFault

EXPOSURE_AFTER_S: Final = 1.0
_BLACK: Final = 32
_WHITE: Final = 225
_MIN_LIT_SHARE: Final = 0.02
_MIN_SHADED_SHARE: Final = 0.10


class DarkJudge(FaultJudge):
    """Next to nothing in the frame is lighter than black."""

    fault: ClassVar[CameraFault] = "dark"
    hides_scene: ClassVar[bool] = True
    after_s: ClassVar[float] = EXPOSURE_AFTER_S

    def look(self, sample: Sample) -> bool:
        """True if this frame is black."""
        lit = np.count_nonzero(sample.grey > _BLACK)
        return bool(lit < _MIN_LIT_SHARE * sample.grey.size)


class BrightJudge(FaultJudge):
    """Next to nothing in the frame is darker than white."""

    fault: ClassVar[CameraFault] = "bright"
    hides_scene: ClassVar[bool] = True
    after_s: ClassVar[float] = EXPOSURE_AFTER_S

    def look(self, sample: Sample) -> bool:
        """True if this frame is white."""
        shaded = np.count_nonzero(sample.grey < _WHITE)
        return bool(shaded < _MIN_SHADED_SHARE * sample.grey.size)
