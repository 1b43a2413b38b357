"""The calibrated camera: image ↔ road plane, and the road segments that it watches.

The road is a plane with coordinates in metres; a 3×3 homography maps it to the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from slipstream.config import Settings, load
from slipstream.errors import InputError
from slipstream.messages import Identifier

Array = npt.NDArray[np.float64]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Pair = tuple[Finite, Finite]


class CalibrationPoint(Settings):
    """A point known both in the picture and on the road."""

    image: Pair = Field(description="(u, v) in px, origin at the top left.")
    road: Pair = Field(description="(x, y) in m.")


class ImageSize(Settings):
    """Size of the picture that the calibration was made on, px."""

    width: Annotated[int, Field(gt=0)]
    height: Annotated[int, Field(gt=0)]


class SegmentSettings(Settings):
    """The part of a road segment that the camera watches."""

    id: Identifier
    polygon: Annotated[tuple[Pair, ...], Field(min_length=3, description="m on the road plane.")]
    direction: Pair = Field(description="Direction of travel on the road plane.")
    lanes: Annotated[int, Field(ge=1)] = 1
    lane_width_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 3.5


class CameraSettings(Settings):
    """The content of a ``camera.toml``."""

    schema_version: Literal[1] = Field(alias="schema")
    name: str
    image: ImageSize
    points: Annotated[tuple[CalibrationPoint, ...], Field(min_length=4)]
    segments: Annotated[tuple[SegmentSettings, ...], Field(min_length=1)]


@dataclass(frozen=True)
class WatchedSegment:
    """A watched part of a road segment in its own coordinates.

    Attributes:
        id: the road segment.
        polygon_m: outline on the road plane, m, shape (n, 2).
        direction: unit vector of travel, shape (2,).
        length_m: extent along the direction.
        lanes: number of lanes.
        lane_width_m: width of a lane.
    """

    id: str
    polygon_m: Array
    direction: Array
    length_m: float
    lanes: int
    lane_width_m: float

    def contains(self, points_m: Array) -> npt.NDArray[np.bool_]:
        """Which points (n, 2), m, lie inside the outline."""
        # Relative to the outline's middle: OpenCV's contours have single precision.
        middle = self.polygon_m.mean(axis=0)
        contour = (self.polygon_m - middle).astype(np.float32).reshape(-1, 1, 2)
        return np.array(
            [
                cv2.pointPolygonTest(contour, (float(x), float(y)), False) >= 0
                for x, y in points_m - middle
            ],
            dtype=np.bool_,
        )

    def along(self, points_m: Array) -> Array:
        """Position along the direction of travel, m, shape (n,)."""
        return np.asarray(points_m @ self.direction)

    def lane(self, points_m: Array) -> npt.NDArray[np.int_]:
        """Lane index of points (n, 2), counted from the right edge of the outline."""
        left = np.array([-self.direction[1], self.direction[0]])
        offset = points_m @ left - (self.polygon_m @ left).min()
        lanes = np.clip(np.floor(offset / self.lane_width_m), 0, self.lanes - 1)
        return np.asarray(lanes, dtype=np.int_)


class Camera:
    """A fixed camera over a road plane.

    Attributes:
        name: its name.
        size: (width, height) of its pictures, px.
        segments: the watched segments.
        reprojection_error_px: root mean square over the calibration points.
    """

    def __init__(
        self,
        name: str,
        size: tuple[int, int],
        road_points_m: Array,
        image_points_px: Array,
        segments: tuple[WatchedSegment, ...],
    ) -> None:
        """Calibrate it from points known on the road and in the picture, both (n, 2), n ≥ 4.

        Raises:
            ValueError: the points fix no homography.
        """
        self.name = name
        self.size = size
        self.segments = segments
        # Relative to the points' middle: with map coordinates of 10⁶ m a homography is ill-posed.
        self._origin = road_points_m.mean(axis=0)
        self._to_image = _fit(road_points_m - self._origin, image_points_px)
        self._to_road: Array = np.asarray(np.linalg.inv(self._to_image), dtype=np.float64)
        self._road_side = float(np.sign(self._depth(image_points_px).mean()))
        misses = self.to_image(road_points_m) - image_points_px
        self.reprojection_error_px = float(np.sqrt(np.mean(np.sum(misses**2, axis=1))))

    def to_image(self, points_m: npt.ArrayLike) -> Array:
        """Road points (n, 2), m, to pixels (n, 2)."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return _project(self._to_image, points - self._origin)

    def to_road(self, points_px: npt.ArrayLike) -> Array:
        """Pixels (n, 2) to road points (n, 2), m; NaN at and above the horizon."""
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        road: Array = _project(self._to_road, points) + self._origin
        road[self._depth(points) * self._road_side <= 1e-9] = np.nan
        return road

    def _depth(self, points_px: Array) -> Array:
        """Homogeneous scale of pixels on the road: it changes sign at the horizon."""
        return np.asarray(points_px @ self._to_road[2, :2] + self._to_road[2, 2])

    def jacobian(self, points_px: npt.ArrayLike) -> Array:
        """∂(x, y)/∂(u, v) of `to_road`, m/px, shape (n, 2, 2)."""
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        h = self._to_road
        homogeneous = points @ h[:, :2].T + h[:, 2]
        scale = homogeneous[:, 2:3]
        road = homogeneous[:, :2] / scale
        return np.asarray(
            (h[None, :2, :2] - road[:, :, None] * h[None, 2:3, :2]) / scale[:, :, None]
        )


def load_camera(path: Path) -> Camera:
    """Read a ``camera.toml``.

    Raises:
        InputError: an unknown key, a wrong type, points that fix no homography, a calibration that
            does not fit its own points, a segment out of the picture, a direction of length zero.
    """
    settings = load(path, CameraSettings)
    ids = [segment.id for segment in settings.segments]
    if len(set(ids)) < len(ids):
        raise InputError(path, "two segments with one id", "rename one", key="segments.id")
    try:
        camera = Camera(
            settings.name,
            (settings.image.width, settings.image.height),
            np.array([point.road for point in settings.points]),
            np.array([point.image for point in settings.points]),
            tuple(_watched(segment, path) for segment in settings.segments),
        )
    except ValueError as error:
        raise InputError(path, str(error), "spread the points", key="points") from None
    if camera.reprojection_error_px > 0.01 * settings.image.width:
        raise InputError(
            path,
            f"the calibration misses its own points by {camera.reprojection_error_px:.1f} px",
            "check for swapped or mistyped points",
            key="points",
        )
    for segment in camera.segments:
        u, v = camera.to_image(segment.polygon_m).T
        if (u.max() < 0) | (u.min() > camera.size[0]) | (v.max() < 0) | (v.min() > camera.size[1]):
            raise InputError(
                path, "outside the picture", "give it in road metres", key=f"segments.{segment.id}"
            )
    return camera


def _fit(road_m: Array, image_px: Array) -> Array:
    """Homography from road to picture.

    Raises:
        ValueError: the points fix none.
    """
    for points, plane in ((road_m, "on the road"), (image_px, "in the picture")):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] <= 1e-3 * spread[0]:
            raise ValueError(f"all points lie on one line {plane}")
    homography, _ = cv2.findHomography(road_m, image_px)
    if homography is None or not np.isfinite(homography).all():
        raise ValueError("no homography fits the points")
    matrix = np.asarray(homography, dtype=np.float64)
    if np.linalg.cond(matrix) > 1e12:
        raise ValueError("the points fix no homography")
    return matrix


def _watched(segment: SegmentSettings, path: Path) -> WatchedSegment:
    direction = np.array(segment.direction)
    norm = float(np.linalg.norm(direction))
    if not norm > 0:
        raise InputError(
            path, "direction has no length", "give a vector", key=f"segments.{segment.id}"
        )
    polygon = np.array(segment.polygon)
    along = polygon @ (direction / norm)
    return WatchedSegment(
        segment.id,
        polygon,
        direction / norm,
        float(along.max() - along.min()),
        segment.lanes,
        segment.lane_width_m,
    )


def _project(matrix: Array, points: Array) -> Array:
    homogeneous = points.reshape(-1, 2) @ matrix[:, :2].T + matrix[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:3])
