"""The homography between an image and the road plane, fitted to points known in both.

Normalised direct linear transform (Hartley and Zisserman, Multiple View Geometry, section 4.4),
then least squares of the misses in the image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

Array = npt.NDArray[np.float64]

_MIN_SPREAD_RATIO: Final = 1e-3
_MIN_SINGULAR_RATIO: Final = 1e-5
_MAX_DEPTH_RATIO: Final = 1e6  # times the mean depth of the points: beyond is called horizon


class CalibrationError(ValueError):
    """Points that fix no usable homography: what is wrong with them, and what to do about it."""

    def __init__(self, problem: str, mend: str) -> None:
        self.problem = problem
        self.mend = mend
        super().__init__(problem)


@dataclass(frozen=True)
class Lines:
    """Points seen at pixels (m, 2) on lines along the road, y = offset (m,), at an unknown x."""

    image_px: Array
    offset_m: Array

    @classmethod
    def none(cls) -> Lines:
        """No lines."""
        return cls(np.zeros((0, 2)), np.zeros(0))


class Homography:
    """Road plane ↔ image, fitted to points on the road and in the image, both (n, 2), n ≥ 4, and to
    lines.

    Attributes:
        origin_m: where ``matrix`` has its road origin, shape (2,).
        matrix: road point relative to the origin, (x, y, 1), to image, shape (3, 3); the third
            coordinate is the depth, positive before the camera, 1 on average over the points.

    Raises:
        CalibrationError: the points lie on a line, or show the road mirrored or inside out.
    """

    def __init__(self, road_m: Array, image_px: Array, lines: Lines | None = None) -> None:
        # Relative to the points' middle: with map coordinates of 10⁶ m a homography is ill-posed.
        self.origin_m = road_m.mean(axis=0)
        lines = Lines.none() if lines is None else lines
        shifted = Lines(lines.image_px, lines.offset_m - self.origin_m[1])
        matrix = _fit(road_m - self.origin_m, image_px, shifted)
        self.matrix: Array = matrix / matrix[2, 2]
        inverse = np.linalg.inv(self.matrix)
        self._inverse_linear = inverse[:, :2].T.copy()
        self._inverse_shift = inverse[:, 2].copy()

    def to_image(self, points_m: npt.ArrayLike) -> Array:
        """Road points (n, 2), m, to pixels (n, 2); NaN behind the camera."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2) - self.origin_m
        homogeneous = points @ self.matrix[:, :2].T + self.matrix[:, 2]
        return np.asarray(homogeneous[:, :2] / _positive(homogeneous[:, 2:]))

    def to_road(self, points_px: npt.ArrayLike) -> Array:
        """Pixels (n, 2) to road points (n, 2), m; NaN at and above the horizon."""
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        homogeneous = points @ self._inverse_linear + self._inverse_shift
        return np.asarray(homogeneous[:, :2] / _positive(homogeneous[:, 2:]) + self.origin_m)

    def to_road_with_jacobian(self, points_px: npt.ArrayLike) -> tuple[Array, Array]:
        """`to_road` and its derivative ∂(x, y)/∂(u, v), m/px, shape (n, 2, 2); NaN likewise."""
        points = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        homogeneous = points @ self._inverse_linear + self._inverse_shift
        scale = _positive(homogeneous[:, 2:])
        road = homogeneous[:, :2] / scale
        linear = self._inverse_linear.T
        jacobian = (linear[:2] - road[:, :, None] * linear[2]) / scale[:, :, None]
        return road + self.origin_m, jacobian

    def to_image_above(self, points_m: npt.ArrayLike, up: Array) -> Array:
        """`to_image` of points (n, 3), m, z up from the road; `up` (3,) is what a metre upwards
        adds to ``matrix``'s image.
        """
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        image = (points[:, :2] - self.origin_m) @ self.matrix[:, :2].T + self.matrix[:, 2]
        image += points[:, 2:] * up
        return np.asarray(image[:, :2] / np.where(image[:, 2:] > 1e-6, image[:, 2:], np.nan))

    def depth(self, points_m: Array) -> Array:
        """Depth of road points (n, 2), as of ``matrix``: not positive behind the camera."""
        return np.asarray((points_m - self.origin_m) @ self.matrix[2, :2] + self.matrix[2, 2])

    def residuals_px(self, road_m: Array, image_px: Array) -> Array:
        """How far each road point's image lies from where it was seen, px, shape (n,)."""
        miss = self.to_image(road_m) - image_px
        return np.hypot(miss[:, 0], miss[:, 1])


def _positive(scale: Array) -> Array:
    return np.where(scale > 1 / _MAX_DEPTH_RATIO, scale, np.nan)


def _fit(road: Array, image: Array, lines: Lines) -> Array:
    for points, plane in ((road, "on the road"), (image, "in the picture")):
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[1] <= _MIN_SPREAD_RATIO * spread[0]:
            raise CalibrationError(f"all points lie on one line {plane}", "spread the points")
    (to_road, road_n), (to_image, image_n) = _normalised(road), _normalised(image)
    x, y = road_n.T
    one, zero = np.ones(len(x)), np.zeros((len(x), 3))
    point = np.column_stack([x, y, one])
    rows = np.concatenate(
        [
            np.hstack([point, zero, -image_n[:, :1] * point]),
            np.hstack([zero, point, -image_n[:, 1:] * point]),
            np.zeros((1, 9)),  # four points give eight rows, of which nine are needed
        ]
    )
    _, strength, basis = np.linalg.svd(rows, full_matrices=False)
    if strength[7] <= _MIN_SINGULAR_RATIO * strength[0]:
        raise CalibrationError(
            "too many of the points lie on one line", "add points away from that line"
        )
    matrix = basis[-1].reshape(3, 3)
    _check_depths(point @ matrix[2])
    matrix = matrix / matrix[2, 2]  # the mean depth, as the points' middle is (0, 0)
    if len(x) > 4 or len(lines.image_px):
        seen = np.column_stack([lines.image_px, np.ones(len(lines.image_px))]) @ to_image.T
        offset = to_road[1, 1] * lines.offset_m + to_road[1, 2]
        matrix = _refine(matrix, point, image_n, seen, offset)
        _check_depths(point @ matrix[2])
    if np.linalg.det(matrix) >= 0:
        raise CalibrationError(
            "the points show the road mirrored",
            "road coordinates are those of a map: y to the left of x; check for swapped points",
        )
    return np.asarray(np.linalg.inv(to_image) @ matrix @ to_road, dtype=np.float64)


def _check_depths(depths: Array) -> None:
    if not ((depths > 1e-9).all() or (depths < -1e-9).all()):
        raise CalibrationError(
            "the points turn the road inside out", "check for swapped or mistyped points"
        )


def _normalised(points: Array) -> tuple[Array, Array]:
    """Shift and scale to mean 0 and mean square 2: the transform, shape (3, 3), and the points."""
    middle = points.mean(axis=0)
    scale = np.sqrt(2 / np.mean(np.sum((points - middle) ** 2, axis=1)))
    transform = np.diag([scale, scale, 1.0])
    transform[:2, 2] = -scale * middle
    return transform, (points - middle) * scale


def _refine(matrix: Array, point: Array, image: Array, line_point: Array, offset: Array) -> Array:
    def misses(h: Array) -> Array:
        matrix = np.append(h, 1.0).reshape(3, 3)
        homogeneous = point @ matrix.T
        off = np.asarray((homogeneous[:, :2] / homogeneous[:, 2:] - image).ravel())
        if not len(offset):
            return off
        # A line l of the road is H⁻ᵀ l in the image.
        inverse = np.linalg.inv(matrix)
        lines = inverse[1] - offset[:, None] * inverse[2]
        across = np.sum(lines * line_point, axis=1) / np.hypot(lines[:, 0], lines[:, 1])
        return np.concatenate([off, across])

    def derivative(h: Array) -> Array:
        homogeneous = point @ np.append(h, 1.0).reshape(3, 3).T
        seen, scaled = homogeneous[:, :2] / homogeneous[:, 2:], point / homogeneous[:, 2:]
        rows = np.zeros((len(point), 2, 8))
        rows[:, 0, :3] = rows[:, 1, 3:6] = scaled
        rows[:, :, 6:] = -seen[:, :, None] * scaled[:, None, :2]
        return rows.reshape(-1, 8)

    exact = derivative if not len(offset) else "2-point"
    found = least_squares(misses, matrix.ravel()[:8], jac=exact, method="lm")
    return np.append(found.x, 1.0).reshape(3, 3)
