"""A picture with its times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Frame:
    """One picture of a source.

    Attributes:
        image: BGR, shape (height, width, 3), uint8.
        media_time_s: a clip's own time, or a camera frame's time of arrival; never runs back, also
            when a clip loops.
        captured_ns: UTC when it was taken or read.
        captured_s: the same moment on this machine's monotonic clock, for latencies.
        cut: True if the scene before it is another one (a loop, a reconnect).
        clock_jump: True if the stream's own clock ran back or leapt before it; the media time
            was mended.
    """

    image: Image
    media_time_s: float
    captured_ns: int
    captured_s: float
    cut: bool = False
    clock_jump: bool = False
