"""A camera's video compression: JPEG blocks, and blocks that repeat where little changes."""

from __future__ import annotations

import cv2
import numpy as np

from slipstream_lab.simulation.streetdrive.rendering.painter import Image

_BLOCK = 16


class Codec:
    """Codes the frames of one camera, one after the other.

    Frames go through baseline JPEG of a quality. As a block-based encoder at a low rate does
    (H.264's skip mode), a block of 16 x 16 px that changes less than the quantiser's step since
    it was last sent is not sent again.
    """

    def __init__(self, quality: int) -> None:
        self._quality = [cv2.IMWRITE_JPEG_QUALITY, quality]
        self._skip_below = 0.05 * (100 - quality)
        self._last: Image | None = None
        self._seen: Image = np.zeros((0, 0, 3), dtype=np.uint8)
        self._passes = quality >= 100

    def code(self, image: Image) -> Image:
        """The picture (h, w, 3) as it arrives; at quality 100 the same one."""
        if self._passes:
            return image
        packed = cv2.imencode(".jpg", image, self._quality)[1]
        result = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), dtype=np.uint8)
        if self._last is not None:
            change = cv2.cvtColor(cv2.absdiff(image, self._seen), cv2.COLOR_BGR2GRAY)
            size = image.shape[1], image.shape[0]
            blocks = (-(-size[0] // _BLOCK), -(-size[1] // _BLOCK))
            mean = cv2.resize(change, blocks, interpolation=cv2.INTER_AREA)
            same = (mean < self._skip_below).astype(np.uint8) * 255
            keep = cv2.resize(same, size, interpolation=cv2.INTER_NEAREST)
            cv2.copyTo(self._last, keep, result)
            cv2.copyTo(image, cv2.bitwise_not(keep), self._seen)
        else:
            self._seen = image.copy()
        self._last = result
        return result
