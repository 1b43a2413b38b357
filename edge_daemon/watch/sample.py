"""What the judges examine of a frame: a few thousand of its pixels, and a small grey copy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera, polygon_mask
from edge_daemon.frame import Frame, Image

Grey = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

GRID_COLUMNS: Final = 160
SMALL_WIDTH: Final = 320
DETAIL_WIDTH: Final = 640
_BLUR_PX: Final = 4.0
_VIEW_EVERY: Final = 4
_STILL_PX: Final = 0.2


@dataclass
class Sample:
    """A frame as the judges examine it; each part is made when it is first asked for.

    Attributes:
        number: of the sampled frames so far, this one included.
        boxes: of the vehicles detected in it, px of the calibrated view, shape (n, 4); None where
            nobody looked.
        all_boxes: those and what may be a vehicle, shape (m, 4); None: `boxes`.
        shift: of its view against the calibrated one, right and down, px; None: not known.
    """

    frame: Frame
    number: int
    boxes: npt.NDArray[np.float32] | None = None
    all_boxes: npt.NDArray[np.float32] | None = None
    shift: Array | None = None

    @property
    def time_s(self) -> float:
        """Media time."""
        return self.frame.media_time_s

    @property
    def shows_view(self) -> bool:
        """Whether the small copy is worth its cost: for every fourth sample."""
        return self.number % _VIEW_EVERY == 1

    @cached_property
    def colours(self) -> Image:
        """Every n-th pixel of every n-th row, not averaged, so that noise is kept, BGR, shape (h,
        w, 3), about 160 columns.
        """
        return sampled(self.frame.image)

    @cached_property
    def grey(self) -> Grey:
        """Grey levels of `colours`, shape (h, w)."""
        return to_grey(self.colours)

    @cached_property
    def detail(self) -> Grey:
        """The `detail_grey` copy of the frame."""
        return detail_grey(self.frame.image)

    @cached_property
    def small(self) -> Grey:
        """The `small_grey` copy of the frame."""
        return small_of(self.detail)

    @cached_property
    def steady(self) -> Grey:
        """`small` with the camera's movement taken out, where that is large enough to be seen."""
        if self.shift is None:
            return self.small
        right, down = self.shift * self.small.shape[1] / self.frame.image.shape[1]
        if np.hypot(right, down) < _STILL_PX:
            return self.small
        move = np.array([[1.0, 0.0, -right], [0.0, 1.0, -down]])
        size = self.small.shape[::-1]
        moved = cv2.warpAffine(self.small, move, size, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(moved, dtype=np.uint8)

    @cached_property
    def texture(self) -> Floats:
        """The `texture` of `small`."""
        return texture(self.small)


def grid_step(width: int) -> int:
    """Distance between sampled pixels, px."""
    return max(1, width // GRID_COLUMNS)


def sampled(image: Image) -> Image:
    """Every n-th pixel of every n-th row of a frame."""
    step = grid_step(image.shape[1])
    return np.ascontiguousarray(image[step // 2 :: step, step // 2 :: step])


def to_grey(image: Image) -> Grey:
    """Grey levels of a BGR image."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def detail_grey(image: Image) -> Grey:
    """Grey copy, at most 640 px wide."""
    height, width = image.shape[:2]
    if width >= 2 * DETAIL_WIDTH:
        # Halving bilinearly takes the mean of four at a fraction of the cost of INTER_AREA.
        image = np.asarray(cv2.resize(image, (width // 2, height // 2)), dtype=np.uint8)
    return _reduced(to_grey(image), DETAIL_WIDTH)


def small_grey(image: Image) -> Grey:
    """Grey copy, at most 320 px wide, each pixel the mean of those that it stands for."""
    return small_of(detail_grey(image))


def small_of(detail: Grey) -> Grey:
    """The `small_grey` of a frame, given its `detail_grey`."""
    return _reduced(detail, SMALL_WIDTH)


def _reduced(grey: Grey, max_width: int) -> Grey:
    height, width = grey.shape
    if width <= max_width:
        return grey
    size = (max_width, max(1, round(height * max_width / width)))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def texture(small: Grey | Floats) -> Floats:
    """A small grey image minus its blurred copy, float32."""
    image = small.astype(np.float32)
    return np.asarray(image - cv2.GaussianBlur(image, (0, 0), _BLUR_PX))


def sharpness(small: Grey, fine_and_coarse: Floats) -> float:
    """Fine contrast as a share of all contrast of a small grey image, given its `texture`: it falls
    out of focus, but not in dim light.
    """
    fine = small - cv2.GaussianBlur(small.astype(np.float32), (0, 0), 1.0)
    coarse = float(np.abs(fine_and_coarse).mean())
    return float(np.abs(fine).mean()) / coarse if coarse > 0 else 0.0


def road_mask(camera: Camera, shape: tuple[int, int], margin: float) -> Mask:
    """Where the watched road is in a scaled image of (height, width), vehicles included, which
    extend beyond its outline by `margin` of the height.
    """
    height, width = shape
    scale = np.array([width / camera.size[0], height / camera.size[1]])
    outlines = [camera.outline_px(segment) * scale for segment in camera.segments]
    return polygon_mask(outlines, shape, round(margin * height))
