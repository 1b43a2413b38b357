"""Black pictures, white ones, and such that show nothing at all."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from edge_daemon.watch.sample import Floats, Grey

_BLACK, _WHITE = 32, 225
_LIT_SHARE = 0.02
_SHADED_SHARE = 0.10
_EDGE_LEVELS = 12
_EDGE_SHARE = 0.01
_SOFT = 0.5

Exposure = Literal["dark", "bright"]


def exposure(grey: Grey) -> Exposure | None:
    """``dark`` if next to nothing is lit, ``bright`` if next to nothing is not."""
    if np.count_nonzero(grey > _BLACK) < _LIT_SHARE * grey.size:
        return "dark"
    if np.count_nonzero(grey < _WHITE) < _SHADED_SHARE * grey.size:
        return "bright"
    return None


def detail(small: Grey) -> float:
    """Share of the pixels of a small grey picture that lie on an edge, in [0, 1]."""
    kernel = np.ones((3, 3), np.uint8)
    edges = cv2.morphologyEx(small, cv2.MORPH_GRADIENT, kernel)
    return float(np.count_nonzero(edges > _EDGE_LEVELS)) / small.size


def sharpness(small: Grey, picture: Floats) -> float:
    """Fine contrast as a share of coarse contrast: it falls out of focus, but not in dim light.

    Args:
        small: a small grey picture.
        picture: its `texture`.
    """
    fine = small - cv2.GaussianBlur(small.astype(np.float32), (0, 0), 1.0)
    coarse = float(np.abs(picture).mean())
    return float(np.abs(fine).mean()) / coarse if coarse > 0 else 0.0


def is_obscured(small: Grey, picture: Floats, usual: float | None) -> bool:
    """Whether the lens is covered, fogged or out of focus.

    Args:
        small: a small grey picture.
        picture: its `texture`.
        usual: `sharpness` of the calibrated view, None while it is not known.
    """
    if detail(small) < _EDGE_SHARE:
        return True
    return usual is not None and sharpness(small, picture) < _SOFT * usual
