"""Which part of the frame holds the watched road: the rest need not be searched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from edge_daemon.camera import Array, Camera, WatchedSegment

VEHICLE_M: Final = (16.5, 2.6, 4.0)
"""Length, width and height of the largest vehicle that has to be whole in the region."""

_STEP_M: Final = 2.0
MARGIN_M: Final = 3.0
"""Before and behind a segment vehicles have to be whole too."""
_MARGIN_PX: Final = 8.0
_ROUNDS: Final = 4
_MIN_DEPTH: Final = 1e-6  # before the camera


@dataclass(frozen=True)
class Region:
    """A rectangle of the frame, px: columns left ≤ u < right, rows top ≤ v < bottom."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def width(self) -> int:
        """Columns."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Rows."""
        return self.bottom - self.top


def road_region(camera: Camera) -> Region | None:
    """The smallest rectangle in which every vehicle on a watched segment, or some metres before
    or behind it, is whole.

    The largest vehicle is put to points along each segment's outline, so that the middle of its
    box's lower edge, which is what counts as its place, stands there; all its boxes are inside. A
    height of h metres spans at most h·σ pixels upwards, σ being the greater singular value of ∂(u,
    v)/∂(x, y) at its foot: across the view, the road is as far as what stands on it.

    None if some of the outline is not below the horizon, or nothing of it is in the frame: then all
    of it has to be searched.
    """
    boxes = []
    for segment in camera.segments:
        outline = _outline(segment)
        found = _boxes(camera, segment, outline)
        if found is None:
            return None
        boxes.append(found)
    low = np.concatenate(boxes)[:, :2].min(axis=0) - _MARGIN_PX
    high = np.concatenate(boxes)[:, 2:].max(axis=0) + _MARGIN_PX
    left, top = (max(0, int(np.floor(value))) for value in low)
    right, bottom = (
        min(size, int(np.ceil(value))) for value, size in zip(high, camera.size, strict=True)
    )
    return Region(left, top, right, bottom) if left < right and top < bottom else None


def _outline(segment: WatchedSegment) -> Array:
    """Points along the outline of the segment made longer at both ends, shape (n, 2), m."""
    corners = segment.polygon_m
    pieces = []
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(2, int(np.linalg.norm(end - begin) / _STEP_M) + 1)
        pieces.append(begin + np.linspace(0, 1, count)[:, None] * (end - begin))
    points = np.concatenate(pieces)
    shift = MARGIN_M * segment.direction
    return np.concatenate([points - shift, points, points + shift])


def _boxes(camera: Camera, segment: WatchedSegment, places_m: Array) -> Array | None:
    """Boxes of the largest vehicle standing at places on the road, shape (n, 4), px."""
    length, width, height = VEHICLE_M
    along = segment.direction
    across = np.array([-along[1], along[0]])
    corners = np.array(
        [
            sign_l * length / 2 * along + sign_w * width / 2 * across
            for sign_l in (-1, 1)
            for sign_w in (-1, 1)
        ]
    )
    wanted = camera.to_image(places_m)
    centres = places_m.copy()
    for _ in range(_ROUNDS):
        feet_m = centres[:, None] + corners
        feet = camera.to_image(feet_m.reshape(-1, 2)).reshape(len(centres), len(corners), 2)
        # Corners that lie too far outside the view for the lens are left out.
        depths = camera.projection.depth(feet_m.reshape(-1, 2)).reshape(feet.shape[:2])
        shown = np.isfinite(feet).all(axis=2) | ~(depths > _MIN_DEPTH)
        some = shown.any(axis=1)
        if not some.any() or np.isnan(camera.to_road(feet[shown])).any():
            return None
        places_m, wanted, centres = places_m[some], wanted[some], centres[some]
        feet, shown = feet[some], shown[some]
        low = np.where(shown[:, :, None], feet, np.inf).min(axis=1)
        high = np.where(shown[:, :, None], feet, -np.inf).max(axis=1)
        foot = np.column_stack([(low[:, 0] + high[:, 0]) / 2, high[:, 1]])
        centres += places_m - camera.to_road(foot)
        if not np.isfinite(centres).all():
            return None
    tops = np.full(shown.shape, np.inf)
    stretch = np.linalg.svd(camera.jacobian(feet[shown]), compute_uv=False)[:, 1]
    tops[shown] = feet[shown][:, 1] - height / stretch
    bottom = np.fmax(wanted[:, 1], foot[:, 1])
    return np.column_stack([low[:, 0], tops.min(axis=1), high[:, 0], bottom])
