"""Chooses what a view of a road has beyond a plane and a pinhole, by what the points ask for."""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np

from edge_daemon.camera.consensus import Inliers, find_inliers, tolerance_px
from edge_daemon.camera.fit import (
    Observations,
    Projection,
    fit_road,
    line_misses_px,
    parameter_count,
)
from edge_daemon.camera.homography import CalibrationError
from edge_daemon.settings import Term

TERMS: Final[tuple[Term, ...]] = ("lens", "arc", "crest")
_MIN_POINTS: Final = 8
_MOST: Final = 0.8
_CLICK_PX: Final = 0.5
_OUTLIER_COST: Final = 16.0
_TERM_COST: Final = 8.0  # of one of several that are tried


def choose_road(
    known: Observations, size: tuple[int, int], only: tuple[Term, ...] | None = None
) -> tuple[Projection, tuple[Term, ...], Inliers]:
    """The model that the points ask for, or that of the terms `only`: its fit, its terms, and the
    points that it rests on.

    Models are compared by a Bayesian information criterion: squared residuals in units of a click's
    variance, ln(residuals) for every parameter, and fixed costs for every term, and for every point
    beyond the first that contradicts.

    Raises:
        CalibrationError: no model fits most of the points.
    """
    tolerance = tolerance_px(size[0])
    found: list[tuple[Projection, Inliers, tuple[Term, ...]]] = []
    problem: CalibrationError | None = None
    plane: Projection | None = None
    n = len(known.road_m)
    choices = [terms for count in range(4) for terms in combinations(TERMS, count)]
    for terms in choices if only is None else [only]:
        need = _MIN_POINTS + 2 * (len(terms) - 1)
        if terms and n < need:
            if only is not None:
                problem = CalibrationError(
                    f"{n} points are given, the terms {', '.join(terms)} need {need}",
                    "add points, or leave terms out",
                )
            continue
        try:
            if terms:
                simpler = [fit for fit, _, fewer in found if fewer and set(fewer) < set(terms)]
                near = simpler[-1] if simpler else plane
                found.append((*_consensus(known, size, terms, tolerance, near), terms))
            else:
                used = find_inliers(known.road_m, known.image_px, tolerance)
                found.append((fit_road(known.only(used), size, ()), used, ()))
                if used.mean() >= _MOST:
                    plane = found[0][0]  # near enough to start from
                if only is None and _is_plane(known, size, found[0][0], used):
                    break
        except CalibrationError as error:
            problem = problem or error
    if not found:
        raise problem or CalibrationError(
            "no model of a road fits most of the points", "check the points for mistakes"
        )
    sums = [_squares(projection, known, used) for projection, used, _ in found]
    spare = [2 * int(used.sum()) - parameter_count(terms) for _, used, terms in found]
    variance = max(
        _CLICK_PX**2, min(total / max(left, 1) for total, left in zip(sums, spare, strict=True))
    )
    costs = [
        total / variance
        + parameter_count(terms) * np.log(2 * n)
        + _TERM_COST * len(terms)
        + _OUTLIER_COST * max(0, n - int(used.sum()) - 1)
        for total, (_, used, terms) in zip(sums, found, strict=True)
    ]
    projection, used, terms = found[int(np.argmin(costs))]
    return projection, terms, used


def _is_plane(known: Observations, size: tuple[int, int], plane: Projection, used: Inliers) -> bool:
    """Whether all terms together do not make up for the cost of one."""
    n = len(used)
    if n < _MIN_POINTS or n - used.sum() > 1:
        return n < _MIN_POINTS
    bound = _TERM_COST + np.log(2 * n)
    total = _squares(plane, known, used)
    if total < bound * _CLICK_PX**2:
        return True
    try:
        full = fit_road(known.only(used), size, TERMS, plane)
    except CalibrationError:
        return False
    left = _squares(full, known, used)
    spare = 2 * int(used.sum()) - parameter_count(TERMS)
    variance = max(_CLICK_PX**2, left / max(spare, 1))
    return bool(total - left < bound * variance)


def _squares(projection: Projection, known: Observations, used: Inliers) -> float:
    misses = projection.residuals_px(known.road_m[used], known.image_px[used])
    lines = line_misses_px(projection, known.lines)
    return float(np.sum(misses**2) + np.sum(np.minimum(lines, 1e3) ** 2))


def _consensus(
    known: Observations,
    size: tuple[int, int],
    terms: tuple[Term, ...],
    tolerance: float,
    near: Projection | None,
) -> tuple[Projection, Inliers]:
    """The fit to the points that agree on it, and which those are."""
    used = np.ones(len(known.road_m), dtype=np.bool_)
    for _ in range(4):
        fit = near = fit_road(known.only(used), size, terms, near)
        misses = np.nan_to_num(fit.residuals_px(known.road_m, known.image_px), nan=np.inf)
        if (misses[used] <= tolerance).all():
            return fit, np.asarray(misses <= tolerance)
        # The first fits are bent by wrong points: what they miss most goes first.
        used = np.asarray(misses <= max(tolerance, 3 * float(np.median(misses))))
        if used.sum() < max(_MIN_POINTS - 1, len(used) // 2 + 1):
            break
    raise CalibrationError(
        "no model of a road fits most of the points", "check the points for mistakes"
    )
