"""How wrong the times of a camera's frames are, from what all vehicles in a frame have in common.

A frame that was taken δ later than its time says shows every vehicle further along by its speed
times δ. With the innovations e of the Kalman filters along the direction of motion, their variances
s² and the speeds v, weighted least squares over the vehicles gives δ = Σ(v e/s²) / Σ(v²/s²), with
variance 1/Σ(v²/s²). The variance of the errors is that of δ over the last seconds less what the
vehicles' own noise adds to it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from edge_daemon.camera import Array

_MIN_SPEED_MPS: Final = 2.0
_MEMORY_S: Final = 4.0
_LEVEL_STD_S: Final = 0.005
"""Weights of the frames' estimates level off where they are more certain than this."""
_MAX_STD_S: Final = 0.1
_UNKNOWN_STD_S: Final = 0.03
_UNKNOWN_FRAMES: Final = 5.0
"""Before vehicles were seen times are taken to be wrong by so much, with the weight of so many."""
_NEGLIGIBLE_STD_S: Final = 0.003
"""Vehicles move some centimetres in it, less than boxes err."""


class FrameTiming:
    """Estimates the variance of the errors of one camera's frame times."""

    def __init__(self) -> None:
        weight = _UNKNOWN_FRAMES / (_LEVEL_STD_S**2 + _UNKNOWN_STD_S**2) ** 2
        self._squares = weight * _UNKNOWN_STD_S**2
        self._weights = weight

    @property
    def variance_s2(self) -> float:
        """Variance of the frame times' errors over the last seconds, s²; 0 where negligible."""
        variance = min(self._squares / self._weights, _MAX_STD_S**2)
        return variance if variance > _NEGLIGIBLE_STD_S**2 else 0.0

    def learn(self, step_s: float, innovations: Array, velocities: Array, variances: Array) -> None:
        """Take in a frame, `step_s` after the one before, whose detections have just been
        associated.

        Args:
            innovations: detected less predicted positions of tracks whose speed is known, m, (n,
                2).
            velocities: of these tracks, m/s, shape (n, 2).
            variances: covariances of the innovations if the time were right, m², shape (n, 2, 2).
        """
        speeds = np.hypot(velocities[:, 0], velocities[:, 1])
        moving = speeds > _MIN_SPEED_MPS
        if not moving.any():
            return
        speed = speeds[moving]
        direction = velocities[moving] / speed[:, None]
        along = np.einsum("ni,ni->n", innovations[moving], direction)
        variance = np.einsum("ni,nij,nj->n", direction, variances[moving], direction)
        spread_s2 = 1 / float(np.sum(speed**2 / variance))
        error_s = spread_s2 * float(np.sum(speed * along / variance))
        keep = float(np.exp(-step_s / _MEMORY_S))
        weight = 1 / (_LEVEL_STD_S**2 + spread_s2) ** 2
        self._squares = keep * self._squares + weight * (error_s**2 - spread_s2)
        self._weights = keep * self._weights + weight
