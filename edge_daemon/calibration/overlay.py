"""The metric grid over the image: a person sees at a glance whether a calibration is right."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from edge_daemon.calibration.calibration import Calibration
from edge_daemon.camera import WatchedSegment
from edge_daemon.camera.checks import outline_px
from edge_daemon.camera.homography import Array
from edge_daemon.drawing import DARK, Colour, Labels, tint
from edge_daemon.frame import Image

_MINOR: Final[Colour] = (190, 190, 60)
_MAJOR: Final[Colour] = (235, 235, 0)
_SEGMENTS: Final[tuple[Colour, ...]] = (
    (0, 159, 230),
    (115, 158, 0),
    (178, 114, 0),
    (167, 121, 204),
)
_GOOD: Final[Colour] = (60, 200, 60)
_BAD: Final[Colour] = (40, 40, 230)
_MIN_LINE_DISTANCE_PX: Final = 7.0
_MAX_LINES: Final = 100
_STEPS_M: Final = (5.0, 10.0, 50.0, 100.0, 1e3, 1e4, 1e5, 1e8)
_WIDTH: Final = 1280


def draw_grid(picture: Image, calibration: Calibration) -> Image:
    """Draw the calibration over a copy of its image, enlarged if it is small.

    Lines every 5 m, stronger and labelled every 10 m (coarser on large roads); segments outlined
    and named, an arrow in the direction of travel; each point as a ring where it was clicked, a
    cross where the calibration puts it, with its number and its miss.
    """
    canvas = _Canvas(picture, calibration)
    # What is placed first has the choice of room.
    _tint_segments(canvas)
    _label_points(canvas)
    _draw_lines(canvas)
    _draw_segments(canvas)
    _draw_points(canvas)
    canvas.labels.draw()
    return canvas.drawn


class _Canvas:
    """The image drawn on, and where the road is in it."""

    def __init__(self, picture: Image, calibration: Calibration) -> None:
        self.calibration = calibration
        self.zoom = max(1, round(_WIDTH / picture.shape[1]))
        self.drawn = np.asarray(
            cv2.resize(picture, None, fx=self.zoom, fy=self.zoom, interpolation=cv2.INTER_CUBIC),
            dtype=np.uint8,
        )
        self.labels = Labels(self.drawn)
        self.font = max(0.4, self.drawn.shape[1] / 2000)
        self.ring = max(4, round(9 * self.font))

    def at(self, road_m: Array) -> Array:
        """Where road points (n, 2) are drawn."""
        return np.asarray(self.zoom * self.calibration.projection.to_image(road_m))

    def outline(self, segment: WatchedSegment) -> Array:
        """Where a segment's outline is drawn."""
        return np.asarray(self.zoom * outline_px(segment.polygon_m, self.calibration.projection))


def _extent(calibration: Calibration) -> tuple[Array, Array]:
    """Corners of the part of the road worth a grid."""
    known = np.concatenate(
        [calibration.road_m[calibration.used], *(s.polygon_m for s in calibration.segments)]
    )
    low, high = known.min(axis=0), known.max(axis=0)
    margin = 0.1 * (high - low).max()
    return low - margin, high + margin


def _draw_lines(canvas: _Canvas) -> None:
    low, high = _extent(canvas.calibration)
    step = next(s for s in _STEPS_M if max(high - low) / s < _MAX_LINES)
    # Map coordinates have six digits: the grid then counts from a round place that it names.
    zero = np.floor(low / 1000) * 1000 if np.abs(low).max() > 1e4 else np.zeros(2)
    if zero.any():
        place = (8.0, canvas.drawn.shape[0] - 8.0)
        canvas.labels.put(f"metres from ({zero[0]:.0f}, {zero[1]:.0f})", [place], canvas.font)
    for axis in (0, 1):
        first, last = np.ceil(low[axis] / step), np.floor(high[axis] / step)
        previous: Array | None = None
        for tick in np.arange(first, last + 1):
            strong = tick % 2 == 0
            line = np.empty((200, 2))
            line[:, axis] = tick * step
            line[:, 1 - axis] = np.linspace(low[1 - axis], high[1 - axis], 200)
            seen = canvas.at(line)
            seen[(np.abs(seen) > 1e5).any(axis=1)] = np.nan
            # Where lines would run into each other, far off, only the strong ones are drawn.
            whole = seen.copy()
            if previous is not None and not strong:
                apart = seen - previous
                seen[np.hypot(apart[:, 0], apart[:, 1]) < _MIN_LINE_DISTANCE_PX] = np.nan
            previous = whole
            _polyline(canvas.drawn, seen, _MAJOR if strong else _MINOR, 2 if strong else 1)
            if strong:
                _label_line(canvas, whole, f"{'xy'[axis]} {tick * step - zero[axis]:.0f} m")


def _polyline(drawn: Image, points: Array, colour: Colour, thickness: int) -> None:
    whole = np.asarray(np.isfinite(points).all(axis=1))
    for i in np.flatnonzero(whole[:-1] & whole[1:]):
        begin, end = (16 * points[i : i + 2]).round().astype(int).tolist()
        cv2.line(drawn, begin, end, colour, thickness, cv2.LINE_AA, 4)


def _label_line(canvas: _Canvas, line: Array, text: str) -> None:
    rows, columns = canvas.drawn.shape[:2]
    inside = (line > 0).all(axis=1) & (line[:, 0] < columns) & (line[:, 1] < rows)
    shown = line[inside]
    if len(shown):
        places = shown[np.linspace(0, len(shown) - 1, 9).astype(int)]
        canvas.labels.put(
            text, [(float(u), float(v)) for u, v in places], canvas.font, colour=_MAJOR
        )


def _tint_segments(canvas: _Canvas) -> None:
    scale = 1.2 * canvas.font
    for i, segment in enumerate(canvas.calibration.segments):
        colour = _SEGMENTS[i % len(_SEGMENTS)]
        outline = canvas.outline(segment)
        tint(canvas.drawn, outline, colour, 0.2)
        u, v = outline.mean(axis=0)
        canvas.labels.put(
            f"{segment.id} ({segment.lanes} x {segment.lane_width_m:g} m)",
            [(u, v + 40 * scale * row) for row in (0, 1, -1, 2, -2)],
            scale,
            background=colour,
        )


def _draw_segments(canvas: _Canvas) -> None:
    for i, segment in enumerate(canvas.calibration.segments):
        colour = _SEGMENTS[i % len(_SEGMENTS)]
        outline = canvas.outline(segment).round().astype(np.int32)
        cv2.polylines(canvas.drawn, [outline], True, colour, 3, cv2.LINE_AA)
        middle = segment.polygon_m.mean(axis=0)
        arrow = canvas.at(middle + np.outer((-0.08, 0.08), segment.direction * segment.length_m))
        tail, head = arrow.round().astype(int).tolist()
        cv2.arrowedLine(canvas.drawn, tail, head, colour, 4, cv2.LINE_AA, tipLength=0.3)


def _label_points(canvas: _Canvas) -> None:
    calibration, side = canvas.calibration, 1.5 * canvas.ring
    clicks = canvas.zoom * calibration.image_px
    for i, ((u, v), miss) in enumerate(zip(clicks, calibration.residuals_px, strict=True)):
        by = f"{miss:.1f} px" if np.isfinite(miss) else "?"
        canvas.labels.put(
            f"{i + 1}: {by}",
            [(u + side, v), (u + side, v + 2 * side), (u - 8 * side, v), (u, v - 1.5 * side)],
            canvas.font,
            background=DARK if calibration.used[i] else _BAD,
        )


def _draw_points(canvas: _Canvas) -> None:
    calibration = canvas.calibration
    clicks = canvas.zoom * calibration.image_px
    for click, there, used in zip(
        clicks, canvas.at(calibration.road_m), calibration.used, strict=True
    ):
        colour = _GOOD if used else _BAD
        at = click.round().astype(int).tolist()
        cv2.circle(canvas.drawn, at, canvas.ring, DARK, 4, cv2.LINE_AA)
        cv2.circle(canvas.drawn, at, canvas.ring, colour, 2, cv2.LINE_AA)
        if np.isfinite(there).all() and np.abs(there).max() < 1e5:
            to = there.round().astype(int).tolist()
            cv2.line(canvas.drawn, at, to, colour, 1, cv2.LINE_AA)
            cv2.drawMarker(canvas.drawn, to, colour, cv2.MARKER_CROSS, 2 * canvas.ring, 1)
