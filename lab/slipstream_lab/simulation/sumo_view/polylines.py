"""Polylines on the road plane: lengths, points and stretches along them, offsets to a side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def distances(line: Floats) -> Floats:
    """Distance of each point of a line (n, 2) from its beginning along the line, m, shape (n,)."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def clean(points: Floats) -> Floats:
    """The line without points that repeat the one before (within 1 cm)."""
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.01])
    return np.asarray(points[keep], dtype=np.float64)


def at(line: Floats, along_m: Floats) -> Floats:
    """Points (k, 2) of a line at distances (k,) from its beginning; ends hold beyond it."""
    s = distances(line)
    return np.column_stack([np.interp(along_m, s, line[:, axis]) for axis in (0, 1)])


def stretch(line: Floats, from_m: float, to_m: float) -> Floats:
    """The part of a line between two distances from its beginning, with its inner points."""
    s = distances(line)
    inner = line[(s > from_m + 0.01) & (s < to_m - 0.01)]
    first, last = at(line, np.array([from_m, to_m]))
    return np.concatenate([[first], inner, [last]])


def shifted(line: Floats, left_m: float) -> Floats:
    """The line moved to its left by a distance (to the right if negative), mitred at corners."""
    steps = np.diff(line, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1)[:, None]
    before = np.concatenate([directions[:1], directions])
    after = np.concatenate([directions, directions[-1:]])
    middle = before + after
    middle /= np.maximum(np.linalg.norm(middle, axis=1), 1e-9)[:, None]
    # A mitre grows without bound in a hairpin; 2 is that of a right angle and a half.
    mitre = 1.0 / np.maximum((middle * after).sum(axis=1), 0.5)
    normals = np.column_stack([-middle[:, 1], middle[:, 0]])
    return np.asarray(line + normals * (left_m * mitre)[:, None], dtype=np.float64)


def nearest_m(line: Floats, point: Floats) -> float:
    """Distance in metres between a point (2,) and a line (n, 2)."""
    a, steps = line[:-1], np.diff(line, axis=0)
    t = ((point - a) * steps).sum(axis=1) / np.maximum((steps**2).sum(axis=1), 1e-12)
    foot = a + steps * np.clip(t, 0.0, 1.0)[:, None]
    return float(np.linalg.norm(foot - point, axis=1).min())
