"""Which detection is of which track, and which points lie on one vehicle."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from edge_daemon.camera import Array
from edge_daemon.tracking.sightings import Indices

_GATE: Final = 13.8  # 99.9 % of χ² with two degrees of freedom
_FORBIDDEN: Final = 1e6
# Two vehicles are never closer than this, along the view and across it, m.
_BODY_M: Final = (2.5, 1.2)


def associate(gap: Array, spread: Array, reach_m: Array) -> tuple[Indices, Indices]:
    """Assign detections to tracks by the Hungarian method on squared Mahalanobis distances.

    Args:
        gap: from each track to each detection, m, shape (n, m, 2).
        spread: covariances of these, m², shape (n, m, 2, 2).
        reach_m: beyond it no detection is a track's, shape (n,).

    Returns:
        Numbers of the tracks and of their detections, shape (k,) each.
    """
    determinant = spread[..., 0, 0] * spread[..., 1, 1] - spread[..., 0, 1] ** 2
    distance = (
        spread[..., 1, 1] * gap[..., 0] ** 2
        - 2 * spread[..., 0, 1] * gap[..., 0] * gap[..., 1]
        + spread[..., 0, 0] * gap[..., 1] ** 2
    ) / determinant
    # The log-determinant keeps an uncertain track from taking a certain one's detection.
    cost = np.where(distance > _GATE, _FORBIDDEN, distance + np.log(determinant))
    cost[np.hypot(gap[..., 0], gap[..., 1]) > reach_m[:, None]] = _FORBIDDEN
    rows, columns = linear_sum_assignment(cost)
    allowed = cost[rows, columns] < _FORBIDDEN
    return rows[allowed], columns[allowed]


def overlap(points: Array, others: Array, away: Array) -> npt.NDArray[np.bool_]:
    """Which of the others (m, 2) lie within a vehicle's body of the points (n, 2), shape (n, m)."""
    gap = others[None] - points[:, None]
    along = np.abs(np.einsum("nmi,ni->nm", gap, away))
    across = np.abs(gap[..., 0] * away[:, None, 1] - gap[..., 1] * away[:, None, 0])
    return np.asarray((along < _BODY_M[0]) & (across < _BODY_M[1]))
