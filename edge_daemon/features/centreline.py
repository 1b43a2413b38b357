"""The centreline of a road, fitted to the vehicles on it. Where the road bends, or a segment's
direction is a few degrees off, distances along that direction, and speeds, come out low by the
cosine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array

_MIN_SPREAD_M: Final = 5.0
_MAX_SLOPE: Final = 1.0


@dataclass(frozen=True)
class Centreline:
    """A parabola: the slope against the segment's direction, lateral metres per metre, changes
    linearly along it; arc lengths count from the origin.
    """

    origin_m: float = 0.0
    slope: float = 0.0
    curvature_per_m: float = 0.0

    def arc_length(self, along_m: Array) -> Array:
        """Distance driven, m, at positions along the direction: ∫ √(1 + slope²)."""
        off = np.asarray(along_m, dtype=np.float64) - self.origin_m
        if abs(self.curvature_per_m) < 1e-7:
            return np.asarray(self.origin_m + np.sqrt(1 + self.slope**2) * off)
        begin = _primitive(np.float64(self.slope))
        end = _primitive(self.slope + self.curvature_per_m * off)
        return np.asarray(self.origin_m + (end - begin) / self.curvature_per_m)


def fit_centreline(vehicle: npt.NDArray[np.intp], along_m: Array, across_m: Array) -> Centreline:
    """Fit the centreline to positions along and across the segment's direction, with each one's
    vehicle, numbered from 0, all shape (n,).

    The least-squares fit over all vehicles, each with its own lateral offset; a straight line where
    they have moved too little.
    """
    if not len(vehicle):
        return Centreline()
    middle = float(along_m.mean())
    off = along_m - middle
    counts = np.bincount(vehicle)

    def centred(values: Array) -> Array:
        return np.asarray(values - (np.bincount(vehicle, values) / counts)[vehicle])

    matrix = np.column_stack([centred(off), centred(off**2 / 2)])
    if np.sqrt(np.mean(matrix[:, 0] ** 2)) < _MIN_SPREAD_M:
        return Centreline(middle)
    slope, bend = np.linalg.lstsq(matrix, centred(across_m), rcond=None)[0]
    reach = float(np.abs(matrix[:, 0]).max())
    if abs(slope) + abs(bend) * reach > _MAX_SLOPE:
        return Centreline(middle)  # implausible: another street is in view, or tracks are mixed up
    return Centreline(middle, float(slope), float(bend))


def _primitive(slope: Array | np.float64) -> Array:
    return np.asarray((slope * np.sqrt(1 + slope**2) + np.arcsinh(slope)) / 2)
