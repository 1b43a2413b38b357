"""The calibrated camera: image ↔ road plane, and the road segments that it watches.

The road is a plane with coordinates in metres; a 3×3 homography maps it to the image.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from edge_daemon.camera.checks import check_points, fit_points, watched_segment
from edge_daemon.camera.homography import Array, Homography
from edge_daemon.camera.pose import CameraPose, pose_of
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.settings import CameraSettings
from slipstream.config import load
from slipstream.errors import InputError


class Camera:
    """A fixed camera over a road plane.

    Attributes:
        name: its name.
        size: (width, height) of its images, px.
        segments: the watched segments.
        homography: between image and road.
        reprojection_error_px: root mean square over the calibration points.
        reference: the image that it was calibrated on, if the calibration names one.
    """

    def __init__(
        self,
        name: str,
        size: tuple[int, int],
        road_points_m: Array,
        image_points_px: Array,
        segments: tuple[WatchedSegment, ...],
        reference: Path | None = None,
    ) -> None:
        """Calibrate it from points known on the road and in the image, both (n, 2), n ≥ 4.

        Raises:
            CalibrationError: the points fix no usable homography.
        """
        self.name = name
        self.size = size
        self.segments = segments
        self.reference = reference
        self.homography = Homography(road_points_m, image_points_px)
        misses = self.homography.residuals_px(road_points_m, image_points_px)
        self.reprojection_error_px = float(np.sqrt(np.mean(misses**2)))

    def to_image(self, points_m: npt.ArrayLike) -> Array:
        """Road points (n, 2), m, to pixels (n, 2); NaN behind the camera."""
        return self.homography.to_image(points_m)

    def to_road(self, points_px: npt.ArrayLike) -> Array:
        """Pixels (n, 2) to road points (n, 2), m; NaN at and above the horizon."""
        return self.homography.to_road(points_px)

    def jacobian(self, points_px: npt.ArrayLike) -> Array:
        """∂(x, y)/∂(u, v) of `to_road`, m/px, shape (n, 2, 2)."""
        return self.homography.to_road_with_jacobian(points_px)[1]

    def to_road_with_jacobian(self, points_px: npt.ArrayLike) -> tuple[Array, Array]:
        """`to_road` and `jacobian` at the cost of one."""
        return self.homography.to_road_with_jacobian(points_px)

    @cached_property
    def pose(self) -> CameraPose | None:
        """Where the camera hangs; None where the homography is that of no plain camera."""
        return pose_of(self.homography, self.size)


def load_camera(path: Path) -> Camera:
    """Read a ``camera.toml``.

    Raises:
        InputError: an unknown key, a wrong type, a reference image that is missing; points
            outside the image, at one place or on a line, that fix no homography or do not fit
            it; a segment that `edge_daemon.camera.checks.watched_segment` refuses.
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
    homography = fit_points(road, image, size, path)
    segments = tuple(
        watched_segment(segment, homography, size, path) for segment in settings.segments
    )
    return Camera(settings.name, size, road, image, segments, reference)
