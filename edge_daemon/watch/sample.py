"""What the judges look at: a few thousand pixels of a picture, and a small grey copy."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Camera
from edge_daemon.frame import Image

Grey = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

GRID_COLUMNS = 160
SMALL_WIDTH = 320
_SURROUNDINGS_PX = 4.0


@dataclass(frozen=True)
class Sample:
    """Pixels of one picture as they are, not averaged, so that noise is kept.

    Attributes:
        time_s: media time.
        image: the whole picture, BGR.
        colours: every n-th pixel of every n-th row, shape (h, w, 3), about 160 columns.
        grey: the same in grey, shape (h, w).
    """

    time_s: float
    image: Image
    colours: Image
    grey: Grey


def take_sample(time_s: float, image: Image) -> Sample:
    """Pick the pixels out of a picture of any size."""
    step = grid_step(image.shape[1])
    colours = np.ascontiguousarray(image[step // 2 :: step, step // 2 :: step])
    return Sample(time_s, image, colours, to_grey(colours))


def grid_step(width: int) -> int:
    """Distance between sampled pixels, px."""
    return max(1, width // GRID_COLUMNS)


def to_grey(image: Image) -> Grey:
    """Grey levels of a BGR picture."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def small_grey(image: Image) -> Grey:
    """Grey copy, at most 320 px wide, each pixel the mean of those that it stands for."""
    height, width = image.shape[:2]
    if width <= SMALL_WIDTH:
        return to_grey(image)
    size = (SMALL_WIDTH, max(1, round(height * SMALL_WIDTH / width)))
    if width >= 2 * SMALL_WIDTH:
        # Halving bilinearly takes the mean of four at a fraction of the cost of INTER_AREA.
        image = np.asarray(cv2.resize(image, (width // 2, height // 2)), dtype=np.uint8)
    return np.asarray(cv2.resize(to_grey(image), size, interpolation=cv2.INTER_AREA), np.uint8)


def texture(small: Grey) -> Floats:
    """A small grey picture less its blurred self, float32."""
    picture = small.astype(np.float32)
    return np.asarray(picture - cv2.GaussianBlur(picture, (0, 0), _SURROUNDINGS_PX))


def road_mask(camera: Camera, shape: tuple[int, int], margin: float) -> Mask:
    """Where the watched road is in a scaled picture of (height, width).

    Args:
        camera: whose segments are meant.
        shape: of the mask.
        margin: how far vehicles reach over the road's outline, as a share of the height.
    """
    height, width = shape
    scale = np.array([width / camera.size[0], height / camera.size[1]])
    mask = np.zeros(shape, dtype=np.uint8)
    for segment in camera.segments:
        outline = camera.to_image(segment.polygon_m) * scale
        if np.isfinite(outline).all():
            # OpenCV draws with 16-bit coordinates.
            cv2.fillPoly(mask, [np.clip(outline, -4096, 4096).round().astype(np.int32)], (1,))
    reach = round(margin * height)
    if reach > 0:
        mask = np.asarray(cv2.dilate(mask, np.ones((2 * reach + 1,) * 2, np.uint8)), dtype=np.uint8)
    return mask.astype(np.bool_)
