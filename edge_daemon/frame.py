"""A frame of a video with its times, and still images from files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from slipstream.files import silent_libraries

Image = npt.NDArray[np.uint8]

MAX_PIXELS: Final = 2**26
"""Of a picture or a video frame; `edge_daemon` tells OpenCV so."""


@dataclass(frozen=True)
class Frame:
    """One frame of a source.

    Attributes:
        image: BGR, shape (height, width, 3), uint8.
        media_time_s: a clip's own time, or a camera frame's time of arrival; never decreases, not
            even when a clip loops.
        captured_ns: UTC when it was taken or read.
        captured_s: the same moment on this machine's monotonic clock, for latencies.
        cut: the scene before it is another one (a loop, a reconnect).
        clock_jump: the stream's own clock stepped before it; the media time is corrected.
        repeated: it shows the frame before once more: nothing is measured in it.
        left_out_s: of a leap of the clip's time stamps before it, what media time does not count.
    """

    image: Image
    media_time_s: float
    captured_ns: int
    captured_s: float
    cut: bool = False
    clock_jump: bool = False
    repeated: bool = False
    left_out_s: float = 0.0


def read_image(path: Path) -> Image | None:
    """An image file as BGR; None where it is missing, no image, or claims to be too large."""
    if not path.is_file():  # a pipe would be waited for
        return None
    try:
        with silent_libraries():
            image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:  # a size beyond its limits, true or forged
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)
