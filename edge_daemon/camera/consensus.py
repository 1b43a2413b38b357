"""Which calibration points are inliers: consensus over homographies through four points."""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera.homography import Array, CalibrationError, Homography

_MAX_TRIALS: Final = 1000
_MIN_POINTS: Final = 6
_MAX_REFINED: Final = 12
_BORDERLINE: Final = 2.0

Inliers = npt.NDArray[np.bool_]


def find_inliers(road_m: Array, image_px: Array, tolerance_px: float) -> Inliers:
    """Which of n points agree on one homography to within a tolerance, shape (n,).

    Homographies through four of the points (all fours are tried, or 1000 of them) vote for the
    points that they meet; the largest votes are refined by least squares. Of fewer than six points
    none can be identified as wrong, so all are inliers.

    Raises:
        CalibrationError: no more than half of the points, or fewer than five, agree, or it cannot
            be told which are wrong.
    """
    n = len(road_m)
    if n < _MIN_POINTS:
        return np.ones(n, dtype=np.bool_)
    enough = max(5, n // 2 + 1)
    best: Inliers | None = None
    suspects = np.zeros(n, dtype=np.bool_)
    for vote in _hypotheses(road_m, image_px, tolerance_px)[:_MAX_REFINED]:
        if vote.sum() < enough:
            break
        agreed = _refine(vote, road_m, image_px, tolerance_px)
        if agreed is None or agreed.sum() < enough:
            continue
        if agreed.all():
            return agreed
        if best is None or agreed.sum() > best.sum():
            best, suspects = agreed, ~agreed
        elif agreed.sum() == best.sum():
            suspects = suspects | ~agreed
    if best is None:
        Homography(road_m, image_px)  # may have a better reason
        raise CalibrationError(
            "no homography fits most of the points", "check the points for mistakes"
        )
    if suspects.sum() > (~best).sum():
        misses = Homography(road_m, image_px).residuals_px(road_m, image_px)
        if (misses <= _BORDERLINE * tolerance_px).all():
            return np.ones(n, dtype=np.bool_)  # imprecise clicks, no mistake
        names = ", ".join(str(i + 1) for i in np.flatnonzero(suspects))
        raise CalibrationError(
            f"{(~best).sum()} of the points {names} must be wrong, but any of them could be",
            "check them, or add points away from them",
        )
    return best


def _hypotheses(road_m: Array, image_px: Array, tolerance_px: float) -> list[Inliers]:
    """Different sets of points met by homographies through four of them, best first."""
    n = len(road_m)
    road = road_m - road_m.mean(axis=0)
    point = np.column_stack([road, np.ones(n)])
    misses: dict[bytes, float] = {}
    for four in _quadruples(n):
        matrix = cv2.getPerspectiveTransform(
            road[four].astype(np.float32), image_px[four].astype(np.float32)
        )
        seen = point @ matrix.T
        with np.errstate(all="ignore"):
            squared = np.sum((seen[:, :2] / seen[:, 2:] - image_px) ** 2, axis=1)
        vote = np.nan_to_num(squared, nan=np.inf) <= tolerance_px**2
        score = float(squared[vote].sum())
        key = vote.tobytes()
        misses[key] = min(score, misses.get(key, np.inf))
    votes = {key: np.frombuffer(key, dtype=np.bool_) for key in misses}
    return [votes[key] for key in sorted(misses, key=lambda k: (-votes[k].sum(), misses[k], k))]


def _refine(agreed: Inliers, road_m: Array, image_px: Array, tolerance_px: float) -> Inliers | None:
    """The points that agree with the least squares fit to those that agree; None without one."""
    for _ in range(10):
        if agreed.sum() < 4:
            return None
        try:
            fit = Homography(road_m[agreed], image_px[agreed])
        except CalibrationError:
            return None
        # A point behind the camera misses by no number.
        misses = np.nan_to_num(fit.residuals_px(road_m, image_px), nan=np.inf)
        now = np.asarray(misses <= tolerance_px)
        if (now == agreed).all():
            break
        agreed = now
    return agreed


def tolerance_px(width: int) -> float:
    """How far a careful click may be off in an image of that width, px."""
    return max(4.0, 0.004 * width)


def _quadruples(n: int) -> list[list[int]]:
    if comb(n, 4) <= _MAX_TRIALS:
        return [list(four) for four in combinations(range(n), 4)]
    rng = np.random.default_rng(0)
    return [sorted(rng.choice(n, 4, replace=False).tolist()) for _ in range(_MAX_TRIALS)]
