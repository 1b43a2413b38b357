"""The pose of a calibrated camera, from its view of the road alone.

Assumes square pixels and the optical axis in the image's middle (no cropped image); with these a
homography fixes the focal length too. A curved road has its camera already.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from edge_daemon.camera.curved import CurvedRoad
from edge_daemon.camera.homography import Array, Homography


@dataclass(frozen=True)
class CameraPose:
    """A camera over the road plane.

    Attributes:
        foot_m: the road point under the optical centre, shape (2,).
        height_m: of the optical centre over the road.
        focal_px: focal length.
        rotation: road frame (x, y, up) to camera frame (right, down, forward), shape (3, 3).
        projection: of the road.
        up: of a homography: what one metre upwards adds to its image, shape (3,).
    """

    foot_m: Array
    height_m: float
    focal_px: float
    rotation: Array
    projection: Homography | CurvedRoad
    up: Array

    def project(self, points_m: npt.ArrayLike) -> Array:
        """Pixels (n, 2) of points (n, 3), m, z up from the road; NaN behind the camera. On the road
        itself it agrees with the projection.
        """
        if isinstance(self.projection, Homography):
            return self.projection.to_image_above(points_m, self.up)
        return self.projection.to_image_above(points_m)

    def centre_offset(self, points_m: Array, headings: Array, sizes_m: Array) -> Array:
        """From the middle of a box's lower edge, on the road, to the middle of its vehicle, m, (n,
        2).

        The vehicle is taken for a body of known size on wheels that stand in from its ends, its box
        for the bounds of their corners: that accounts for its near end, its side faces and its
        height. NaN where such a vehicle is not in view.

        Args:
            points_m: middles of boxes' lower edges on the road, shape (n, 2).
            headings: unit vectors along the vehicles, shape (n, 2).
            sizes_m: length, width, height, shape (n, 3).
        """
        sideways = np.column_stack([-headings[:, 1], headings[:, 0]])
        length, height = sizes_m[:, :1], sizes_m[:, 2:]
        wheels = length - 2 * np.minimum(_OVERHANG * length, _MAX_OVERHANG_M)
        reach = np.hstack([wheels, length, length])[:, :, None] * _ENDS
        corners = np.empty((len(points_m), 3, 4, 3))
        corners[..., :2] = (
            reach[..., None] * headings[:, None, None]
            + (_SIDES[:, None] * (sideways * sizes_m[:, 1:2])[:, None])[:, None]
        )
        corners[..., 2] = np.hstack([0 * height, _CLEARANCE * height, height])[:, :, None]
        offset = np.zeros_like(points_m)
        for _ in range(2):  # the offset varies slowly over the road
            there = corners.copy()
            there[..., :2] += (points_m + offset)[:, None, None]
            seen = self.project(there).reshape(-1, 12, 2)
            lower = (seen.min(axis=1) + seen.max(axis=1)) / 2
            lower[:, 1] = seen[:, :, 1].max(axis=1)
            offset += points_m - self.projection.to_road(lower)
        return offset


_ENDS = np.array([-0.5, -0.5, 0.5, 0.5])
_SIDES = np.array([-0.5, 0.5, -0.5, 0.5])
_OVERHANG, _MAX_OVERHANG_M = 0.17, 1.1  # beyond the axles, of the length
_CLEARANCE = 0.15  # under the bumpers, of the height


def pose_of(view: Homography | CurvedRoad, size: tuple[int, int]) -> CameraPose | None:
    """The pose behind a view of the road in images of (width, height); None where no such camera
    can have made it.

    The images of a plane's axes are those of two orthogonal vectors of one length, which gives two
    equations for 1/f², solved by least squares (Zhang's method for one view of a plane).
    """
    if isinstance(view, CurvedRoad):
        return CameraPose(view.foot_m, view.height_m, view.focal_px, view.matrix, view, np.zeros(3))
    homography = view
    centred = homography.matrix.copy()
    centred[:2] -= np.outer([size[0] / 2, size[1] / 2], homography.matrix[2])
    a, b = centred[:, 0], centred[:, 1]
    in_picture = np.array([a[:2] @ b[:2], (a[:2] @ a[:2] - b[:2] @ b[:2]) / 2])
    in_depth = np.array([a[2] * b[2], (a[2] ** 2 - b[2] ** 2) / 2])
    if not in_picture @ in_picture > 0:
        return None
    inverse_square = -float(in_picture @ in_depth) / float(in_picture @ in_picture)
    if not 1e-10 < inverse_square < 1e-2:  # f between 10 and 100 000 px
        return None
    focal = inverse_square**-0.5
    rays = centred / np.array([[focal], [focal], [1.0]])
    left, stretch, right = np.linalg.svd(rays[:, :2], full_matrices=False)
    x, y = (left @ right).T
    scale = float(stretch.mean())
    z = np.cross(x, y)
    foot_x, foot_y, height = -np.stack([x, y, z]) @ rays[:, 2] / scale
    up = scale * z * np.array([focal, focal, 1.0])
    up[:2] += np.array([size[0] / 2, size[1] / 2]) * up[2]
    foot = homography.origin_m + np.array([foot_x, foot_y])
    rotation = np.column_stack([x, y, z])
    return CameraPose(foot, float(height), focal, rotation, homography, up)
