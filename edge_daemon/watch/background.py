"""What in the road's picture is not the empty road, by a background model of each pixel.

The model is a mixture of Gaussians a pixel (Zivkovic, ICPR 2004).
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.watch.sample import Grey, Mask, texture

_HISTORY_SAMPLES: Final = 300
_LEARN_SAMPLES: Final = 20
_MAX_VARIANCES: Final = 25.0
_FOREGROUND: Final = 255  # OpenCV marks shadows by another value
_CHANGED_LEVELS: Final = 10.0
_STILL_LEVELS: Final = 12
_BOX_MARGIN: Final = 0.3
_BOX_MARGIN_PX: Final = 2.0


class Background:
    """Knows the empty road; takes samples in order of time.

    Attributes:
        foreground: where the last sample differs from the background, in the small grey image,
            shadows left out; None while the background is being learned.
        changed: where the last sample differs from the one before it.
    """

    def __init__(self, road: Mask, zoom: float) -> None:
        """Set it up.

        Args:
            road: where vehicles drive in the small grey image.
            zoom: width of the small grey image over that of the frame.
        """
        self._road = road
        self._zoom = zoom
        self.restart()

    def restart(self) -> None:
        """Forget all: the next frame may show another scene or another light."""
        self._model = cv2.createBackgroundSubtractorMOG2(
            _HISTORY_SAMPLES, _MAX_VARIANCES, detectShadows=True
        )
        self._samples = 0
        self._small: Grey | None = None
        self.changed = np.zeros_like(self._road)
        self.foreground: Mask | None = None

    def update(self, small: Grey, *, learn: bool) -> None:
        """Take in a sample.

        Args:
            small: the `small_grey` copy of a frame.
            learn: False: it is compared with the background, and does not become part of it.
        """
        self._samples += 1
        if self._small is not None:
            self.changed = np.asarray(cv2.absdiff(small, self._small) > _STILL_LEVELS)
        self._small = small
        found = np.asarray(self._model.apply(small, learningRate=-1.0 if learn else 0.0))
        self.foreground = found == _FOREGROUND if self._samples > _LEARN_SAMPLES else None

    def unexplained(self, boxes: npt.NDArray[np.float32]) -> tuple[float, float] | None:
        """How much of the last sample is changed, at rest, and no vehicle.

        Changed means fine contrast that the background lacks, so that light may change.

        Args:
            boxes: of the vehicles in it, px of the frame, shape (n, 4).

        Returns:
            Shares of the road and of the rest of the picture; None while the background is being
            learned.
        """
        if self.foreground is None or self._small is None:
            return None
        at_rest = self.foreground & ~self.changed
        for left, top, right, bottom in (boxes * self._zoom).tolist():
            aside = _BOX_MARGIN * (right - left) + _BOX_MARGIN_PX
            above = _BOX_MARGIN * (bottom - top) + _BOX_MARGIN_PX
            rows = slice(max(0, int(top - above)), max(0, int(bottom + above) + 1))
            at_rest[rows, max(0, int(left - aside)) : max(0, int(right + aside) + 1)] = False
        if not at_rest.any():
            return 0.0, 0.0
        empty = np.asarray(self._model.getBackgroundImage(), dtype=np.uint8)
        at_rest &= np.abs(texture(self._small) - texture(empty)) > _CHANGED_LEVELS
        return _share(at_rest, self._road), _share(at_rest, ~self._road)


def _share(found: Mask, part: Mask) -> float:
    return float(np.count_nonzero(found & part)) / max(1, int(np.count_nonzero(part)))
