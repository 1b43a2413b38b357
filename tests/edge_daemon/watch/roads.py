"""An empty road as a sensor sees it, and what may be done to its picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Camera
from edge_daemon.frame import Frame

Picture = npt.NDArray[np.uint8]
Change = Callable[[Picture, float], Picture]

EVERY_S = 0.2


@dataclass(frozen=True)
class Road:
    """An empty road: the median of a clip, without its noise and vehicles."""

    picture: Picture
    camera: Camera
    noise: tuple[npt.NDArray[np.int16], ...]

    def seen(self, number: int, change: Change | None = None) -> Picture:
        """The picture as a sensor delivers it, with fresh noise of two grey levels."""
        time_s = number * EVERY_S
        scene = self.picture if change is None else change(self.picture, time_s)
        noise = self.noise[(7 * number) % len(self.noise)]
        noise = np.roll(noise, 31 * number, axis=1)
        return np.clip(scene + noise, 0, 255).astype(np.uint8)


def at(time_s: float, picture: Picture) -> Frame:
    """A frame whose clocks all agree."""
    return Frame(picture, time_s, round(1e18 + 1e9 * time_s), time_s)


def warped(move: npt.ArrayLike) -> Change:
    """What a camera sees that was moved by an affine transform of the picture."""
    matrix = np.asarray(move, dtype=np.float32)

    def change(picture: Picture, _: float) -> Picture:
        moved = cv2.warpAffine(picture, matrix, (1280, 720), borderMode=cv2.BORDER_REFLECT)
        return np.asarray(moved, dtype=np.uint8)

    return change


def shifted(right_px: float, down_px: float = 0.0) -> Change:
    """What a camera sees that was turned a little."""
    return warped([[1, 0, right_px], [0, 1, down_px]])
