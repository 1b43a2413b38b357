"""Single pictures from files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from edge_daemon.frame import Image


def readable_picture(path: Path) -> Image | None:
    """A picture file as BGR; None where it is missing or no picture, or claims to be too large."""
    try:
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    except cv2.error:  # a size beyond its limits, true or forged
        return None
    return None if picture is None else np.asarray(picture, dtype=np.uint8)
