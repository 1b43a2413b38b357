"""The calibrated camera: image ↔ road, a plane or a `CurvedRoad`, and the segments it watches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera.checks import (
    check_lines,
    check_masks,
    check_points,
    fit_points,
    outline_px,
    watched_segment,
)
from edge_daemon.camera.fit import Observations, Projection
from edge_daemon.camera.homography import Array, Homography
from edge_daemon.camera.pose import CameraPose, pose_of
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.settings import CameraSettings
from slipstream.config import load
from slipstream.errors import InputError

_HIDDEN_BGR: Final = (114, 114, 114)
"""Neither dark nor bright."""


class Camera:
    """A fixed camera over a road, calibrated from points known on the road and in the image, both
    (n, 2), n ≥ 4.

    Attributes:
        size: (width, height) of its images, px.
        segments: the watched segments.
        projection: between image and road; default: a plane through the points.
        reference: the image that it was calibrated on, if the calibration names one.
        masks: outlines of what must not be looked at, px, each (n, 2).
        reprojection_error_px: root mean square over the calibration points.

    Raises:
        CalibrationError: the points fix no usable homography.
    """

    def __init__(
        self,
        name: str,
        size: tuple[int, int],
        road_points_m: Array,
        image_points_px: Array,
        segments: tuple[WatchedSegment, ...],
        reference: Path | None = None,
        projection: Projection | None = None,
        masks: Sequence[Array] = (),
    ) -> None:
        self.name = name
        self.size = size
        self.segments = segments
        self.reference = reference
        self.masks = tuple(masks)
        self.projection = projection or Homography(road_points_m, image_points_px)
        misses = self.projection.residuals_px(road_points_m, image_points_px)
        self.reprojection_error_px = float(np.sqrt(np.mean(misses**2)))

    def to_image(self, points_m: npt.ArrayLike) -> Array:
        """Road points (n, 2), m, to pixels (n, 2); NaN behind the camera."""
        return self.projection.to_image(points_m)

    def to_road(self, points_px: npt.ArrayLike) -> Array:
        """Pixels (n, 2) to road points (n, 2), m; NaN at and above the horizon."""
        return self.projection.to_road(points_px)

    def jacobian(self, points_px: npt.ArrayLike) -> Array:
        """∂(x, y)/∂(u, v) of `to_road`, m/px, shape (n, 2, 2)."""
        return self.projection.to_road_with_jacobian(points_px)[1]

    def to_road_with_jacobian(self, points_px: npt.ArrayLike) -> tuple[Array, Array]:
        """`to_road` and `jacobian` at the cost of one."""
        return self.projection.to_road_with_jacobian(points_px)

    def outline_px(self, segment: WatchedSegment) -> Array:
        """A segment's outline in the image, px, shape (n, 2): curved where the road is."""
        return outline_px(segment.polygon_m, self.projection)

    @cached_property
    def pose(self) -> CameraPose | None:
        """Where the camera hangs; None where a homography is that of no plain camera."""
        return pose_of(self.projection, self.size)


def hide(image: npt.NDArray[np.uint8], masks: Sequence[Array]) -> None:
    """Make grey in a picture what lies within outlines, px, each (n, 2)."""
    if masks:
        cv2.fillPoly(image, [mask.round().astype(np.int32) for mask in masks], _HIDDEN_BGR)


def load_camera(path: Path) -> Camera:
    """Read a ``camera.toml``.

    Raises:
        InputError: it is none, the reference image is missing, its points fix no view of the road
            or do not fit it, or `watched_segment` or `check_masks` refuses a part.
    """
    settings = load(path, CameraSettings)
    ids = [segment.id for segment in settings.segments]
    if len(set(ids)) < len(ids):
        raise InputError(path, "two segments with one id", "rename one", key="segments.id")
    reference = None if settings.reference is None else path.parent / settings.reference
    if reference is not None and not reference.is_file():
        raise InputError(
            path, f"no such picture: {reference}", "mend the path or remove it", key="reference"
        )
    size = (settings.image.width, settings.image.height)
    road, image = check_points(settings.points, size, path)
    known = Observations(road, image, check_lines(settings.lines, size, path))
    projection = fit_points(known, size, settings.terms, path)
    segments = tuple(
        watched_segment(segment, projection, size, path) for segment in settings.segments
    )
    outlines = [outline_px(segment.polygon_m, projection) for segment in segments]
    masks = check_masks(settings.masks, outlines, size, path)
    return Camera(settings.name, size, road, image, segments, reference, projection, masks)
