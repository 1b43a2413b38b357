"""Mapping of a part of the frame into a network's input, and of boxes back."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import numpy as np
import numpy.typing as npt

from edge_daemon.detection.region import Region

_BORDER_PX = 2.0  # px of the network's input: nearer to the border of what was searched is cut off

_ROUNDING = 1e-6

Boxes = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Placement:
    """What is cut out of a frame and where it lies in the network's input.

    Attributes:
        picture: (width, height) of the frame, px.
        crop: the part of it that is searched.
        shape: (height, width) of the network's input, px.
        inner: where the scaled crop lies in the input; what is around it is padding.
    """

    picture: tuple[int, int]
    crop: Region
    shape: tuple[int, int]
    inner: Region

    def to_picture(self, boxes: Boxes) -> Boxes:
        """Boxes (n, 4) as x1, y1, x2, y2 from px of the input to px of the frame."""
        scale = np.array(
            [self.crop.width / self.inner.width, self.crop.height / self.inner.height] * 2
        )
        shift = np.array([self.crop.left, self.crop.top] * 2)
        start = np.array([self.inner.left, self.inner.top] * 2)
        return np.asarray((boxes - start) * scale + shift, dtype=np.float32)

    def uncut(self, boxes: Boxes) -> npt.NDArray[np.bool_]:
        """Which boxes (n, 4), px of the frame, the crop's left, right and lower border spare; those
        of the frame itself are not considered.
        """
        near = _BORDER_PX * self.crop.width / self.inner.width
        keep = np.ones(len(boxes), dtype=np.bool_)
        if self.crop.left > 0:
            keep &= boxes[:, 0] > self.crop.left + near
        if self.crop.right < self.picture[0]:
            keep &= boxes[:, 2] < self.crop.right - near
        if self.crop.bottom < self.picture[1]:
            keep &= boxes[:, 3] < self.crop.bottom - near
        return keep


def place_dynamic(
    picture: tuple[int, int], wanted: Region, scale: float, stride: int = 32
) -> Placement:
    """An input as small as the wanted part of a picture (width, height) needs at `scale` px of
    input a px of frame, in multiples of the network's stride.

    What the rounding adds is filled with more of the frame, below and on both sides, and with
    padding only where the frame ends.
    """
    left, right, columns = _stretch(wanted.left, wanted.right, picture[0], scale, stride, 0.5)
    top, bottom, rows = _stretch(wanted.top, wanted.bottom, picture[1], scale, stride, 0.0)
    crop = Region(left, top, right, bottom)
    size = min(columns, round(crop.width * scale)), min(rows, round(crop.height * scale))
    return Placement(picture, crop, (rows, columns), _middle((rows, columns), size))


def place_aligned(
    picture: tuple[int, int], wanted: Region, scale: float, stride: int = 32
) -> Placement:
    """Those cells of the whole picture's layout that hold the wanted part; arguments of
    `place_dynamic`.

    A network's answer to a vehicle depends on where it lies between the multiples of the stride:
    here that is where it would lie if the whole picture were searched.
    """
    columns, left, right, u = _cells(wanted.left, wanted.right, picture[0], scale, stride)
    rows, top, bottom, v = _cells(wanted.top, wanted.bottom, picture[1], scale, stride)
    width = min(columns - u, round((right - left) * scale))
    height = min(rows - v, round((bottom - top) * scale))
    crop = Region(left, top, right, bottom)
    return Placement(picture, crop, (rows, columns), Region(u, v, u + width, v + height))


def place_static(picture: tuple[int, int], wanted: Region, shape: tuple[int, int]) -> Placement:
    """The wanted part in the middle of an input of fixed (height, width), its aspect kept."""
    scale = min(shape[1] / wanted.width, shape[0] / wanted.height)
    size = max(1, round(wanted.width * scale)), max(1, round(wanted.height * scale))
    return Placement(picture, wanted, shape, _middle(shape, size))


def _middle(shape: tuple[int, int], size: tuple[int, int]) -> Region:
    left, top = (shape[1] - size[0]) // 2, (shape[0] - size[1]) // 2
    return Region(left, top, left + size[0], top + size[1])


def _stretch(
    low: int, high: int, limit: int, scale: float, stride: int, before: float
) -> tuple[int, int, int]:
    """(low, high) stretched to fill a multiple of the stride, and that multiple."""
    cells = _whole_cells((high - low) * scale, stride)
    length = min(limit, round(cells / scale))
    start = low - int(before * max(0, length - (high - low)))
    start = min(max(0, start), limit - length)
    return start, start + length, cells


def _cells(low: int, high: int, limit: int, scale: float, stride: int) -> tuple[int, int, int, int]:
    """For the cells that hold a part: px of the input, the crop, where in the input it begins."""
    before = (_whole_cells(limit * scale, stride) - round(limit * scale)) // 2
    begin = floor((before + low * scale) / stride + _ROUNDING) * stride
    end = _whole_cells(before + high * scale, stride)
    low = max(0, round((begin - before) / scale))
    high = min(limit, round((end - before) / scale))
    return end - begin, low, high, max(0, before - begin)


def _whole_cells(length: float, stride: int) -> int:
    return max(1, ceil(length / stride - _ROUNDING)) * stride
