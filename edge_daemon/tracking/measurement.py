"""Boxes to points on the road, each with the covariance that the camera's view gives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array, Camera
from edge_daemon.detection import Detections, box_feet

_EDGE_PX = 3.0
_MAX_STD_M = 3.0  # beyond, a box says too little about where its vehicle is
# Spread of a box's lower edge's middle against truth, over 16,000 boxes of rendered traffic: a part
# in pixels that all have, a part of the box's size that grows as it is covered and as scores fall.
_NOISE_PX = (0.9, 0.5)
_NOISE_OF_SIZE = 0.012
_NOISE_OF_COVER = 0.15
_MAX_NOISE_OF_COVER = 0.1
_NOISE_OF_DOUBT = 0.2
_SURE_SCORE = 0.8


@dataclass(frozen=True)
class RoadPoints:
    """Where detected vehicles touch the road: the middles of their boxes' lower edges, m (n, 2),
    with covariances (n, 2, 2), unit vectors along which the camera looks past them, and their
    detections.
    """

    points_m: Array
    covariances_m2: Array
    away: Array
    scores: npt.NDArray[np.float32]
    boxes: npt.NDArray[np.float32]
    classes: npt.NDArray[np.int64]


def to_road_points(detections: Detections, camera: Camera) -> RoadPoints:
    """Place detections on the road; those cut off by the frame's edge, above the horizon or
    too far to be placed go.

    A box is uncertain by some half a pixel and a share of its size, more where nearer vehicles
    cover it and where the detector is unsure, and far pixels are worth more metres:
    R = J diag(σ²) Jᵀ with the homography's Jacobian J.
    """
    return place_on_road(detections, _covered(detections.boxes), camera)


def place_on_road(detections: Detections, covered: Array, camera: Camera) -> RoadPoints:
    """`to_road_points`, given the share of each box that others cover, shape (n,)."""
    boxes = detections.boxes
    width, height = camera.size
    whole = (
        (boxes[:, 0] > _EDGE_PX)
        & (boxes[:, 2] < width - _EDGE_PX)
        & (boxes[:, 3] < height - _EDGE_PX)
    )
    ground = box_feet(boxes)
    points = camera.to_road(ground)
    keep = whole & np.isfinite(points).all(axis=1)
    sizes = (boxes[keep, 2:] - boxes[keep, :2]).astype(np.float64)
    share = (
        _NOISE_OF_SIZE
        + np.minimum(_NOISE_OF_COVER * covered[keep], _MAX_NOISE_OF_COVER)
        + _NOISE_OF_DOUBT * np.maximum(0.0, _SURE_SCORE - detections.scores[keep])
    )
    sigma = np.hypot(_NOISE_PX, share[:, None] * sizes)
    jacobian = camera.jacobian(ground[keep])
    spread = jacobian * sigma[:, None, :]
    covariances = spread @ spread.transpose(0, 2, 1)
    placed = np.trace(covariances, axis1=1, axis2=2) < _MAX_STD_M**2
    keep[keep] = placed
    jacobian, covariances = jacobian[placed], covariances[placed]
    # Up in the frame is away on the road.
    away = -jacobian[:, :, 1]
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return RoadPoints(
        points[keep],
        covariances,
        away,
        detections.scores[keep],
        boxes[keep],
        detections.classes[keep],
    )


def _covered(boxes: npt.NDArray[np.float32]) -> Array:
    """Share of each box that boxes of nearer vehicles cover; overlaps among those count twice."""
    low = np.maximum(boxes[:, None, :2], boxes[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:])
    both = np.prod(np.clip(high - low, 0.0, None), axis=2)
    nearer = boxes[None, :, 3] > boxes[:, None, 3]
    area = np.maximum(np.prod(boxes[:, 2:] - boxes[:, :2], axis=1), 1.0)
    return np.asarray((both * nearer).sum(axis=1) / area, dtype=np.float64)
