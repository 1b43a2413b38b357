"""Grid, horizon and outlines of a calibration as the page draws them: lines of pixels."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from edge_daemon.camera import Array
from edge_daemon.camera.checks import outline_px
from edge_daemon.camera.consensus import Inliers
from edge_daemon.camera.fit import Projection
from edge_daemon.settings import PointsSettings

_STEPS_M: Final = tuple(part * 10.0**power for power in range(8) for part in (1, 2, 5))
_MAX_LINES: Final = 30
_LINE_POINTS: Final = 60
_HORIZON_ROWS: Final = 400


def clean(points: Array) -> list[list[float] | None]:
    """Places (n, 2) for JSON: None where there is none, or far outside."""
    return [
        [round(float(u), 1), round(float(v), 1)] if abs(u) < 1e5 and abs(v) < 1e5 else None
        for u, v in points
    ]


def grid(projection: Projection, road_m: Array) -> list[dict[str, Any]]:
    """Lines of constant x and of constant y over the known part of the road."""
    low, high = road_m.min(axis=0), road_m.max(axis=0)
    margin = 0.15 * (high - low)
    low, high = low - margin, high + margin
    lines: list[dict[str, Any]] = []
    for axis in (0, 1):
        extent = high[axis] - low[axis]
        step = next(s for s in _STEPS_M if extent / s <= _MAX_LINES)
        for tick in np.arange(np.ceil(low[axis] / step), np.floor(high[axis] / step) + 1) * step:
            line = np.empty((_LINE_POINTS, 2))
            line[:, axis] = tick
            line[:, 1 - axis] = np.linspace(low[1 - axis], high[1 - axis], _LINE_POINTS)
            strong = bool(round(tick / step) % 5 == 0)
            label = f"{'xy'[axis]} {tick:g} m" if strong else ""
            seen = clean(projection.to_image(line))
            lines.append({"label": label, "strong": strong, "line": seen})
    return lines


def horizon(projection: Projection, size: tuple[int, int]) -> list[list[float] | None]:
    """The highest places of the picture, column by column, that lie on the road as calibrated."""
    columns = np.linspace(0, size[0], 9)
    rows = np.linspace(0, size[1], _HORIZON_ROWS)
    places = np.array([(u, v) for u in columns for v in rows])
    known = np.isfinite(projection.to_road(places)[:, 0]).reshape(len(columns), -1)
    first = np.argmax(known, axis=1)
    return [
        [float(u), float(rows[i])] if known[k].any() and i > 0 else None
        for k, (u, i) in enumerate(zip(columns, first, strict=True))
    ]


def drawn(
    projection: Projection, given: PointsSettings, used: Inliers, size: tuple[int, int]
) -> dict[str, Any]:
    """All that the page draws of a fit, and its points' misses."""
    road = np.array([point.road for point in given.points])
    image = np.array([point.image for point in given.points])
    misses = projection.residuals_px(road, image)
    outlines = [
        clean(outline_px(np.array(segment.polygon), projection)) for segment in given.segments
    ]
    return {
        "points": [
            {"miss": float(miss) if np.isfinite(miss) else None, "used": bool(one), "at": at}
            for miss, one, at in zip(misses, used, clean(projection.to_image(road)), strict=True)
        ],
        "grid": grid(projection, road[used]),
        "horizon": horizon(projection, size),
        "outlines": outlines,
    }
