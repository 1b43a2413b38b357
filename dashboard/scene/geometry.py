"""Geometry of the map's lines: offsets, dashes, lengths, arrowheads.

Arrays of points have the shape (N, 2), arrays of strokes (N, 2, 2): start and end of each, in m.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_MITRE_LIMIT = 1.5


def drop_repeated_points(points: Sequence[tuple[float, float]] | Array) -> Array:
    """The points without consecutive duplicates; at least two are kept."""
    array = np.asarray(points, dtype=np.float64)
    keep = np.concatenate(([True], np.any(np.diff(array, axis=0) != 0.0, axis=1)))
    kept = array[keep]
    # A road of zero length still needs a direction.
    return kept if len(kept) >= 2 else np.vstack((kept, kept + np.array([1e-3, 0.0])))


def offset(points: Array, distance_m: float) -> Array:
    """The line offset to its right by a distance, with mitred corners."""
    moved: Array = points + distance_m * right_normals(points)
    return moved


def right_normals(points: Array) -> Array:
    """Displacement of each point for an offset of 1 m to the right, with mitred corners."""
    direction = np.diff(points, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    right = np.column_stack((direction[:, 1], -direction[:, 0]))
    before, after = np.vstack((right[:1], right)), np.vstack((right, right[-1:]))
    middle = before + after
    length = np.linalg.norm(middle, axis=1, keepdims=True)
    # A U-turn has no mitre; there the corner is cut square.
    middle = np.where(length > 1e-9, middle / np.maximum(length, 1e-9), before)
    stretch = 1.0 / np.maximum(np.sum(middle * before, axis=1, keepdims=True), 1.0 / _MITRE_LIMIT)
    moves: Array = stretch * middle
    return moves


def strokes(points: Array) -> Array:
    """The line's strokes."""
    return np.stack((points[:-1], points[1:]), axis=1)


def length_m(points: Array) -> float:
    """Length of the line."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def point_at(points: Array, fraction: float) -> tuple[Array, Array]:
    """The point at a fraction (0 to 1) of the line's length, and the line's direction there."""
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    goal = min(max(fraction, 0.0), 1.0) * lengths.sum()
    ends = np.cumsum(lengths)
    index = min(int(np.searchsorted(ends, goal)), len(steps) - 1)
    rest = goal - (ends[index] - lengths[index])
    direction: Array = steps[index] / lengths[index]
    return points[index] + rest * direction, direction


def dash_strokes(points: Array, dash_m: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """The line cut into dashes of about the same length.

    Returns:
        The strokes, and for each the index of its dash; a dash around a corner has several strokes.
    """
    total = length_m(points)
    count = max(1, round(total / dash_m))
    corners = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    cuts = np.unique(np.concatenate((np.linspace(0.0, total, count + 1), corners)))
    # Cuts nearer than a thousandth of a dash differ by rounding only.
    cuts = cuts[np.concatenate(([True], np.diff(cuts) > total / count * 1e-3))]
    if len(cuts) < 2:
        cuts = np.array([0.0, total])
    xy = np.column_stack([np.interp(cuts, corners, points[:, axis]) for axis in (0, 1)])
    middles = (cuts[:-1] + cuts[1:]) / 2
    return strokes(xy), np.minimum((middles / total * count).astype(np.int64), count - 1)


def arrowheads(places: Array, ahead: Array, size_m: float) -> Array:
    """Strokes of arrowheads, (2N, 2, 2), at places (N, 2) along unit vectors (N, 2)."""
    side = np.column_stack((-ahead[:, 1], ahead[:, 0]))
    tips = places + ahead * size_m / 2
    barbs = [
        np.stack((tips - size_m * (ahead + turn * side), tips), axis=1) for turn in (0.7, -0.7)
    ]
    return np.stack(barbs, axis=1).reshape(-1, 2, 2)


def ribbon(points: Array, width_m: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """The line as a flat band: corners, (2N, 2), and triangles of their indices, (2N − 2, 3)."""
    across = right_normals(points) * width_m / 2
    corners = np.stack((points + across, points - across), axis=1).reshape(-1, 2)
    right = 2 * np.arange(len(points) - 1)
    ahead = np.column_stack((right, right + 2, right + 3))
    back = np.column_stack((right, right + 3, right + 1))
    return corners, np.concatenate((ahead, back))


def bands(strokes_m: Array, widths_m: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    """Strokes, (N, 2, 2), as flat bands: corners, (4N, 2), and triangles of them, (2N, 3)."""
    step = strokes_m[:, 1] - strokes_m[:, 0]
    length = np.maximum(np.hypot(*step.T), 1e-9)
    right = np.column_stack((step[:, 1], -step[:, 0])) * (widths_m / 2 / length)[:, None]
    start, end = strokes_m[:, 0], strokes_m[:, 1]
    corners = np.stack((start + right, end + right, end - right, start - right), axis=1)
    first = 4 * np.arange(len(step))[:, None]
    faces = np.concatenate((first + np.array([0, 1, 2]), first + np.array([0, 2, 3])))
    return corners.reshape(-1, 2), faces


def nearest_stroke(strokes_m: Array, place_m: Array) -> tuple[int, float]:
    """The stroke of (N, 2, 2) nearest to a place, and its distance, m."""
    start, step = strokes_m[:, 0], strokes_m[:, 1] - strokes_m[:, 0]
    length_2 = np.maximum(np.sum(step * step, axis=1), 1e-12)
    share = np.clip(np.sum((place_m - start) * step, axis=1) / length_2, 0.0, 1.0)
    away_m = np.hypot(*(start + share[:, None] * step - place_m).T)
    index = int(np.argmin(away_m))
    return index, float(away_m[index])
