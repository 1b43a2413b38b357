"""Which calibration points contradict the others."""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.homography import Array, CalibrationError, Homography

_MOST_TRIALS: Final = 1000
_FEWEST: Final = 6


def agreeing(road_m: Array, image_px: Array, tolerance_px: float) -> npt.NDArray[np.bool_]:
    """Which of n points agree on one homography to within a tolerance, shape (n,).

    The homography through four points that leaves the least truncated squared misses decides (all
    fours are tried, or 1000 of them), then least squares over those that agree with it. Of fewer
    than six points none can be told to be wrong, so all agree.

    Raises:
        CalibrationError: no more than half of the points, or fewer than five, agree.
    """
    n = len(road_m)
    if n < _FEWEST:
        return np.ones(n, dtype=np.bool_)
    middle = road_m.mean(axis=0)
    road = road_m - middle
    best, least = None, np.inf
    for four in _fours(n):
        matrix = cv2.getPerspectiveTransform(
            road[four].astype(np.float32), image_px[four].astype(np.float32)
        )
        seen = np.column_stack([road, np.ones(n)]) @ matrix.T
        with np.errstate(all="ignore"):
            squared = np.sum((seen[:, :2] / seen[:, 2:] - image_px) ** 2, axis=1)
        score = np.minimum(np.nan_to_num(squared, nan=np.inf), tolerance_px**2).sum()
        if score < least:
            best, least = squared <= tolerance_px**2, score
    for _ in range(10):
        if best is None or best.sum() < max(5, n // 2 + 1):
            raise CalibrationError(
                "no homography fits most of the points", "check the points for mistakes"
            )
        fit = Homography(road_m[best], image_px[best])
        # A point behind the camera misses by no number.
        now = np.nan_to_num(fit.misses_px(road_m, image_px), nan=np.inf) <= tolerance_px
        if (now == best).all():
            break
        best = now
    return np.asarray(best, dtype=np.bool_)


def tolerance_px(width: int) -> float:
    """How far a careful click may be off in a picture of that width, px."""
    return max(4.0, 0.004 * width)


def _fours(n: int) -> list[list[int]]:
    if comb(n, 4) <= _MOST_TRIALS:
        return [list(four) for four in combinations(range(n), 4)]
    rng = np.random.default_rng(0)
    return [sorted(rng.choice(n, 4, replace=False).tolist()) for _ in range(_MOST_TRIALS)]
