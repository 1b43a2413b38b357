"""Boxes to points on the road, each with the covariance that the camera's view gives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera
from edge_daemon.detection import Detections

_EDGE_PX = 3.0
_NOISE_PX = 1.0
_NOISE_OF_HEIGHT = 0.02
_HIDDEN = 4.0  # what a guessed lower edge is worth less than a seen one


@dataclass(frozen=True)
class RoadPoints:
    """Where detected vehicles touch the road.

    Attributes:
        points_m: the middle of the box's lower edge on the road plane, m, shape (n, 2).
        covariances_m2: of the points, shape (n, 2, 2).
        scores: of the detections, shape (n,).
        boxes: of the detections, px, shape (n, 4).
        classes: of the detections, shape (n,).
    """

    points_m: Array
    covariances_m2: Array
    scores: npt.NDArray[np.float32]
    boxes: npt.NDArray[np.float32]
    classes: npt.NDArray[np.int64]


def to_road_points(detections: Detections, camera: Camera) -> RoadPoints:
    """Place detections on the road; those cut off by the picture's edge or above the horizon go.

    A box is uncertain by about a pixel plus a share of its height, more where a nearer vehicle
    hides its lower edge, and far pixels are worth more metres: R = J diag(σ²) Jᵀ with the
    homography's Jacobian J.
    """
    boxes = detections.boxes
    width, height = camera.size
    whole = (
        (boxes[:, 0] > _EDGE_PX)
        & (boxes[:, 2] < width - _EDGE_PX)
        & (boxes[:, 3] < height - _EDGE_PX)
    )
    ground = np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]]).astype(np.float64)
    points = camera.to_road(ground)
    keep = whole & np.isfinite(points).all(axis=1)
    sigma = _NOISE_PX + _NOISE_OF_HEIGHT * (boxes[keep, 3] - boxes[keep, 1]).astype(np.float64)
    sigma[_hidden(boxes)[keep]] *= _HIDDEN
    jacobian = camera.jacobian(ground[keep])
    covariances = sigma[:, None, None] ** 2 * (jacobian @ jacobian.transpose(0, 2, 1))
    return RoadPoints(
        points[keep], covariances, detections.scores[keep], boxes[keep], detections.classes[keep]
    )


def _hidden(boxes: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Whose lower edge's middle lies behind another box, one that stands nearer."""
    foot_u, foot_v = (boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]
    behind = (
        (boxes[None, :, 0] < foot_u[:, None])
        & (foot_u[:, None] < boxes[None, :, 2])
        & (boxes[None, :, 1] < foot_v[:, None])
        & (foot_v[:, None] < boxes[None, :, 3])
    )
    return np.asarray(behind.any(axis=1), dtype=np.bool_)
