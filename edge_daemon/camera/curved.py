"""A road that is no plane, seen through a lens that is no pinhole.

Road coordinates are then those of a road's design: x is the station along the road, y the offset to
its left. In plan the road is an arc, in profile a parabola (a vertical curve), and the lens has one
radial coefficient (Brown and Conrady, as in OpenCV). Pixels are square, and the optical axis meets
the middle of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera.homography import Array

_SAMPLES: Final = np.linspace(0.0, 1.0, 17) ** 2
_STEPS: Final = 5
_UNDISTORT_STEPS: Final = 6
_REACH: Final = 4.0  # so many half lengths of the calibrated stretch a ray is followed


@dataclass(frozen=True)
class CurvedRoad:
    """Road surface ↔ image; the same methods as a `Homography`.

    Attributes:
        origin_m: station and offset of the middle of the calibrated stretch, shape (2,).
        half_m: half the stretch's length. Beyond it the profile goes on straight.
        size: (width, height) of the image, px.
        focal_px: focal length.
        rotation: road frame to camera frame (right, down, forward), a rotation vector, shape (3,).
        shift_m: the road frame's origin in the camera frame, shape (3,).
        distortion: shift of a ray at the picture's corner, as a share of its distance from the
            middle without distortion; OpenCV's k₁ is this times (2 f / diagonal)².
        curvature_per_m: of the road in plan, positive to the left, 1/m.
        bend_per_m: change of the gradient along the road, 1/m; negative on a crest.
    """

    origin_m: Array
    half_m: float
    size: tuple[int, int]
    focal_px: float
    rotation: Array
    shift_m: Array
    distortion: float = 0.0
    curvature_per_m: float = 0.0
    bend_per_m: float = 0.0

    def to_image(self, points_m: npt.ArrayLike) -> Array:
        """Road points (n, 2), m, to pixels (n, 2); NaN behind the camera and beyond the lens."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return self._pixels(self._in_camera(self.surface(points)))

    def to_image_above(self, points_m: npt.ArrayLike) -> Array:
        """The same of points (n, 3), m, the third coordinate upwards from the road."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
        places = self.surface(points[:, :2])
        places[:, 2] += points[:, 2]
        return self._pixels(self._in_camera(places))

    def to_road(self, points_px: npt.ArrayLike) -> Array:
        """Pixels (n, 2) to the first road points (n, 2), m, that their rays meet; NaN where there
        is none.
        """
        pixels = np.asarray(points_px, dtype=np.float64).reshape(-1, 2)
        return self._flat(self._met(self._rays(pixels))) + self.origin_m

    def to_road_with_jacobian(self, points_px: npt.ArrayLike) -> tuple[Array, Array]:
        """`to_road` and its derivative ∂(x, y)/∂(u, v), m/px, shape (n, 2, 2); NaN likewise."""
        road = self.to_road(points_px)
        forward = self.derivative(road)
        (a, b), (c, d) = forward.transpose(1, 2, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        return road, inverse.transpose(2, 0, 1)

    def depth(self, points_m: Array) -> Array:
        """Depth of road points (n, 2), m: not positive behind the camera."""
        points = np.asarray(points_m, dtype=np.float64).reshape(-1, 2)
        return np.asarray(self._in_camera(self.surface(points))[:, 2])

    def residuals_px(self, road_m: Array, image_px: Array) -> Array:
        """How far each road point's image lies from where it was seen, px, shape (n,)."""
        miss = self.to_image(road_m) - image_px
        return np.hypot(miss[:, 0], miss[:, 1])

    @cached_property
    def matrix(self) -> Array:
        """Road frame to camera frame, a rotation, shape (3, 3)."""
        return np.asarray(cv2.Rodrigues(self.rotation)[0], dtype=np.float64)

    @cached_property
    def centre_m(self) -> Array:
        """The optical centre in the road frame (x along the road, z up), shape (3,)."""
        return np.asarray(-self.matrix.T @ self.shift_m)

    @cached_property
    def foot_m(self) -> Array:
        """Station and offset of the optical centre, shape (2,)."""
        return np.asarray(self._flat(self.centre_m[None])[0] + self.origin_m)

    @property
    def height_m(self) -> float:
        """Of the optical centre over the road's profile at its station."""
        off = self.foot_m - self.origin_m
        return float(self.centre_m[2] - self._height(off[:1])[0])

    def surface(self, points_m: Array) -> Array:
        """Road points (n, 2) in the road frame, m, shape (n, 3)."""
        along, left = (points_m - self.origin_m).T
        turn = self.curvature_per_m * along
        places = np.empty((len(along), 3))
        places[:, 0] = along * np.sinc(turn / np.pi) - left * np.sin(turn)
        half = np.sinc(turn / (2 * np.pi))
        places[:, 1] = along * turn / 2 * half**2 + left * np.cos(turn)
        places[:, 2] = self._height(along)
        return places

    def derivative(self, points_m: Array) -> Array:
        """∂(u, v)/∂(x, y) of `to_image` at road points (n, 2), px/m, shape (n, 2, 2)."""
        along, left = (points_m - self.origin_m).T
        turn = self.curvature_per_m * along
        cos, sin, zero = np.cos(turn), np.sin(turn), np.zeros_like(turn)
        stretch = 1 - self.curvature_per_m * left
        columns = np.array(
            [[cos * stretch, -sin], [sin * stretch, cos], [self._gradient(along), zero]]
        )
        places = self._in_camera(self.surface(points_m))
        moved = np.einsum("ij,jkn->nik", self.matrix, columns)
        depth = np.where(places[:, 2] > 1e-6, places[:, 2], np.nan)[:, None]
        seen = self.focal_px * places[:, :2] / depth
        plain = (self.focal_px * moved[:, :2] - seen[:, :, None] * moved[:, 2:]) / depth[:, :, None]
        squared = np.sum(seen**2, axis=1)[:, None, None]
        outer = seen[:, :, None] * seen[:, None, :]
        lens = (1 + self._k * squared) * np.eye(2) + 2 * self._k * outer
        return np.asarray(lens @ plain)

    @cached_property
    def _k(self) -> float:
        return self.distortion * 4 / float(self.size[0] ** 2 + self.size[1] ** 2)

    def _height(self, along: Array) -> Array:
        far = np.minimum(np.abs(along), self.half_m)
        return np.asarray(self.bend_per_m * far * (np.abs(along) - far / 2))

    def _gradient(self, along: Array) -> Array:
        return np.asarray(self.bend_per_m * np.clip(along, -self.half_m, self.half_m))

    def _in_camera(self, places: Array) -> Array:
        return np.asarray(places @ self.matrix.T + self.shift_m)

    def _pixels(self, places: Array) -> Array:
        depth = np.where(places[:, 2:] > 1e-6, places[:, 2:], np.nan)
        seen = self.focal_px * places[:, :2] / depth
        squared = np.sum(seen**2, axis=1, keepdims=True)
        # Farther out the one coefficient would fold places back into the picture.
        folded = 1 + 3 * self._k * squared <= 0
        shown = np.where(folded, np.nan, seen * (1 + self._k * squared))
        return np.asarray(shown + np.array(self.size) / 2)

    def _rays(self, pixels: Array) -> Array:
        """Directions of pixels (n, 2) in the road frame, depth 1, shape (n, 3)."""
        shown = pixels - np.array(self.size) / 2
        if self._k != 0:
            squared = np.sum(shown**2, axis=1)
            factor = np.ones(len(shown))  # by which the lens moves the ray outwards
            for _ in range(_UNDISTORT_STEPS):
                # factor · (1 + k · squared · factor²) = 1, by Newton's method.
                slope = 1 + 3 * self._k * squared * factor**2
                factor -= (factor * (1 + self._k * squared * factor**2) - 1) / slope
            folded = 1 + 3 * self._k * squared * factor**2 <= 1e-3
            shown = shown * np.where(folded, np.nan, factor)[:, None]
        directions = np.column_stack([shown / self.focal_px, np.ones(len(shown))])
        return np.asarray(directions @ self.matrix)

    def _met(self, rays: Array) -> Array:
        """Where rays from the camera first meet the road, in the road frame, shape (n, 3)."""
        if self.bend_per_m == 0:
            down = np.where(rays[:, 2:] < -1e-9, rays[:, 2:], np.nan)
            return np.asarray(self.centre_m - self.centre_m[2] * rays / down)
        level = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-9)
        reach = np.hypot(*self.centre_m[:2]) + _REACH * self.half_m
        times = (reach / level)[:, None] * _SAMPLES
        above = self._above(rays, times) > 0
        # A camera hangs over the road, whatever the profile says below it.
        above[:, 0] = True
        first = np.argmin(above, axis=1)
        rows = np.arange(len(rays))
        low, high = times[rows, np.maximum(first - 1, 0)], times[rows, first]
        at = (low + high) / 2
        for _ in range(_STEPS):
            over, fall = self._above(rays, at[:, None])[:, 0], self._fall(rays, at)
            low, high = np.where(over > 0, at, low), np.where(over > 0, high, at)
            with np.errstate(divide="ignore", invalid="ignore"):
                there = at - over / fall
            inside = (there >= low) & (there <= high)
            at = np.where(inside, there, (low + high) / 2)
        missed = (first == 0) | ~np.isfinite(rays).all(axis=1)
        return np.asarray(self.centre_m + np.where(missed, np.nan, at)[:, None] * rays)

    def _above(self, rays: Array, times: Array) -> Array:
        """Height over the road along rays (n, 3) at times (n, m), m."""
        places = self.centre_m + rays[:, None] * times[:, :, None]
        along = self._flat(places.reshape(-1, 3))[:, 0].reshape(times.shape)
        return np.asarray(places[..., 2] - self._height(along))

    def _fall(self, rays: Array, times: Array) -> Array:
        """Change of that height along the ray."""
        places = self.centre_m + rays * times[:, None]
        off = self._flat(places)
        turn = self.curvature_per_m * off[:, 0]
        forward = rays[:, 0] * np.cos(turn) + rays[:, 1] * np.sin(turn)
        forward = forward / (1 - self.curvature_per_m * off[:, 1])
        return np.asarray(rays[:, 2] - self._gradient(off[:, 0]) * forward)

    def _flat(self, places: Array) -> Array:
        """Station and offset, from the origin, of places (n, 3) in the road frame, shape (n, 2)."""
        if self.curvature_per_m == 0:
            return np.array(places[:, :2])
        side = np.copysign(1.0, self.curvature_per_m)
        radius = 1 / abs(self.curvature_per_m)
        x, y = places[:, 0], radius - side * places[:, 1]
        along = radius * np.arctan2(x, y)
        return np.column_stack([along, side * (radius - np.hypot(x, y))])
