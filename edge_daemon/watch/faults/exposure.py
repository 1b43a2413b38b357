"""`dark` and `bright`: frames that are black or white."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from edge_daemon.watch.sample import Sample
from slipstream.messages import CameraFault

_BLACK: Final = 32
_WHITE: Final = 225
_MIN_LIT_SHARE: Final = 0.02
_MIN_SHADED_SHARE: Final = 0.10


class DarkJudge:
    """Next to nothing in the frame is lighter than black."""

    fault: ClassVar[CameraFault] = "dark"
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = True

    def __init__(self, after_s: float) -> None:
        self.after_s = after_s

    def look(self, sample: Sample) -> bool:
        """True if this frame is black."""
        lit = np.count_nonzero(sample.grey > _BLACK)
        return bool(lit < _MIN_LIT_SHARE * sample.grey.size)

    def interrupt(self, by: CameraFault | None) -> None:
        """Each frame is judged by itself."""


class BrightJudge:
    """Next to nothing in the frame is darker than white."""

    fault: ClassVar[CameraFault] = "bright"
    every_frame: ClassVar[bool] = False
    hides_scene: ClassVar[bool] = True

    def __init__(self, after_s: float) -> None:
        self.after_s = after_s

    def look(self, sample: Sample) -> bool:
        """True if this frame is white."""
        shaded = np.count_nonzero(sample.grey < _WHITE)
        return bool(shaded < _MIN_SHADED_SHARE * sample.grey.size)

    def interrupt(self, by: CameraFault | None) -> None:
        """Each frame is judged by itself."""
