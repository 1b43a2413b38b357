"""What lens and sensor do to a picture: blur, vignette, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slipstream_lab.simulation.streetdrive.rendering.painter import Image


@dataclass(frozen=True)
class SensorSettings:
    """Blur in pixels (sigma), corner darkening 0..1, noise in grey levels (sigma)."""

    blur_px: float = 0.6
    vignette: float = 0.18
    noise_levels: float = 3.0

    def __post_init__(self) -> None:
        if min(self.blur_px, self.vignette, self.noise_levels) < 0 or self.vignette >= 1:
            raise ValueError("blur and noise are not negative and the vignette lies in 0..1")


class Sensor:
    """Applies the same lens and fresh noise to each frame of one camera."""

    def __init__(
        self, settings: SensorSettings, width: int, height: int, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._rng = rng
        self._size = (height, width)
        grid_v, grid_u = np.mgrid[0:height, 0:width].astype(np.float32)
        radius2 = ((grid_u - width / 2) ** 2 + (grid_v - height / 2) ** 2) / (
            (width / 2) ** 2 + (height / 2) ** 2
        )
        shade = np.rint(255 * (1 - settings.vignette * radius2)).astype(np.uint8)
        self._vignette: Image = np.repeat(shade[..., None], 3, axis=2)
        # One larger field of noise read at a random offset per frame is far cheaper than new noise.
        field = rng.standard_normal((height + 128, width + 128, 3)).astype(np.float32)
        field *= np.float32(settings.noise_levels)
        self._brighter = np.clip(np.rint(field), 0, 255).astype(np.uint8)
        self._darker = np.clip(np.rint(-field), 0, 255).astype(np.uint8)

    def expose(self, image: Image) -> Image:
        """The picture as the sensor delivers it, a new array (h, w, 3)."""
        result: NDArray[np.uint8] = image
        if self._settings.blur_px > 0:
            result = np.asarray(
                cv2.GaussianBlur(result, (0, 0), self._settings.blur_px), dtype=np.uint8
            )
        if self._settings.vignette > 0:
            result = np.asarray(cv2.multiply(result, self._vignette, scale=1 / 255), dtype=np.uint8)
        if self._settings.noise_levels > 0:
            top, left = (int(value) for value in self._rng.integers(0, 128, 2))
            window = np.s_[top : top + self._size[0], left : left + self._size[1]]
            result = np.asarray(cv2.add(result, self._brighter[window]), dtype=np.uint8)
            result = np.asarray(cv2.subtract(result, self._darker[window]), dtype=np.uint8)
        return result
