"""A pinhole roadside camera over the road plane z = 0.

World axes: x along the road away from the camera, y to the left, z up, all in metres.
Image axes: u to the right, v down, in pixels, origin at the top-left corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PinholeCamera:
    """A camera on a pole at (0, lateral_m, height_m) that looks along +x.

    Yaw turns the view to the left (towards +y), pitch turns it down, roll turns it clockwise.
    """

    height_m: float
    lateral_m: float
    pitch_rad: float
    yaw_rad: float
    focal_px: float
    roll_rad: float = 0.0
    width_px: int = 1280
    height_px: int = 720

    def __post_init__(self) -> None:
        if not (self.height_m > 0 and self.focal_px > 0):
            raise ValueError("a camera's height and focal length are positive")
        if not 0 < self.pitch_rad < math.pi / 2:
            raise ValueError("a roadside camera's pitch lies between 0 and 90 degrees")

    @cached_property
    def position_m(self) -> Floats:
        """Optical centre in world coordinates, shape (3,)."""
        return np.array([0.0, self.lateral_m, self.height_m])

    @cached_property
    def rotation(self) -> Floats:
        """World to camera rotation, shape (3, 3): rows are the right, down and forward axes."""
        cos_p, sin_p = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cos_y, sin_y = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        forward = np.array([cos_y * cos_p, sin_y * cos_p, -sin_p])
        right = np.array([sin_y, -cos_y, 0.0])
        down = np.cross(forward, right)
        cos_r, sin_r = math.cos(self.roll_rad), math.sin(self.roll_rad)
        return np.stack([cos_r * right + sin_r * down, cos_r * down - sin_r * right, forward])

    def project(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Pixels (..., 2) and depths along the optical axis in metres (...) of points (..., 3).

        Pixels of points at a depth of 0 or less have no meaning; the caller tests the depth.
        """
        local = (points_m - self.position_m) @ self.rotation.T
        depth = local[..., 2]
        scale = self.focal_px / np.where(np.abs(depth) < 1e-6, 1e-6, depth)
        centre = np.array([self.width_px / 2, self.height_px / 2])
        return local[..., :2] * scale[..., None] + centre, depth

    @cached_property
    def ground_homography(self) -> Floats:
        """Homography, shape (3, 3), from (x_m, y_m, 1) on the road plane to pixels."""
        intrinsics = np.array(
            [
                [self.focal_px, 0.0, self.width_px / 2],
                [0.0, self.focal_px, self.height_px / 2],
                [0.0, 0.0, 1.0],
            ]
        )
        translation = -self.rotation @ self.position_m
        columns = np.column_stack([self.rotation[:, 0], self.rotation[:, 1], translation])
        return np.asarray(intrinsics @ columns, dtype=np.float64)

    def to_ground(self, pixels: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Road points (..., 2) in metres under pixels (..., 2), and where the ray meets the road.

        A ray at or above the horizon meets no road: its mask is false and its point is (0, 0).
        """
        inverse = np.linalg.inv(self.ground_homography)
        rays = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1) @ inverse.T
        # The homography's third coordinate is depth, so its inverse's is 1/depth.
        hits = rays[..., 2] > 1e-6
        weight = np.where(hits, rays[..., 2], 1.0)
        points = rays[..., :2] / weight[..., None]
        return np.where(hits[..., None], points, 0.0), hits

    def sees(self, pixels: Floats, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Whether pixels (..., 2) lie inside the picture by at least margin_px."""
        u, v = pixels[..., 0], pixels[..., 1]
        inside_u = (u >= margin_px) & (u <= self.width_px - 1 - margin_px)
        return np.asarray(
            inside_u & (v >= margin_px) & (v <= self.height_px - 1 - margin_px), dtype=np.bool_
        )
