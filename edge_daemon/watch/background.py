"""What is not the usual background: a mixture of Gaussians a pixel (Zivkovic, ICPR 2004)."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from edge_daemon.watch.sample import Grey, Mask

_HISTORY_SAMPLES: Final = 300
_LEARN_SAMPLES: Final = 20
_MAX_VARIANCES: Final = 25.0
_FOREGROUND: Final = 255  # OpenCV marks shadows by another value
_STILL_LEVELS: Final = 12


class Background:
    """Knows the usual view; takes samples in order of time.

    Attributes:
        foreground: where the last sample differs from the background, in the small grey image,
            shadows left out; None while the background is being learned.
        changed: where the last sample differs from the one before it; None for the first.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all: the next frame may show another scene or another light."""
        self._model = cv2.createBackgroundSubtractorMOG2(
            _HISTORY_SAMPLES, _MAX_VARIANCES, detectShadows=True
        )
        self._samples = 0
        self._small: Grey | None = None
        self.changed: Mask | None = None
        self.foreground: Mask | None = None

    def update(self, small: Grey) -> None:
        """Take in the `small_grey` copy of a frame."""
        self._samples += 1
        if self._small is not None:
            self.changed = np.asarray(cv2.absdiff(small, self._small) > _STILL_LEVELS)
        self._small = small
        found = np.asarray(self._model.apply(small))
        self.foreground = found == _FOREGROUND if self._samples > _LEARN_SAMPLES else None
