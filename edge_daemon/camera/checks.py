"""What a calibration must satisfy beyond its types: each fault is one line with its mend."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera.consensus import find_inliers, tolerance_px
from edge_daemon.camera.fit import Observations, Projection, fit_road, line_misses_px
from edge_daemon.camera.homography import Array, CalibrationError, Homography, Lines
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.settings import CalibrationLine, CalibrationPoint, Masks, SegmentSettings, Term
from slipstream.errors import InputError

_MAX_RMS_SHARE: Final = 0.01  # of the image's width
_SAME_PX, _SAME_M = 0.5, 0.01
_MIN_AREA_M2: Final = 1.0
_MIN_VISIBLE_SHARE: Final = 0.5
_PIECES: Final = 24  # of an outline's edge on a curved road
_LINE_TOLERANCE: Final = 4.0  # of a point's: points alone say little of places between them
_MAX_HIDDEN_M: Final = 2.0
_MOST_PX: Final = 16384


def check_points(
    points: tuple[CalibrationPoint, ...], size: tuple[int, int], source: Path
) -> tuple[Array, Array]:
    """Points on the road, m, and in the image, px, both (n, 2), none outside it, no two at one
    place.
    """
    road = np.array([point.road for point in points])
    image = np.array([point.image for point in points])
    for i, (u, v) in enumerate(image):
        if not (0 <= u <= size[0] and 0 <= v <= size[1]):
            raise InputError(
                source,
                f"point {i + 1} at ({u:g}, {v:g}) lies outside the {size[0]}×{size[1]} picture",
                "mend its pixel or the picture's size",
                key="points",
            )
    for where, places, same in (
        ("in the picture", image, _SAME_PX),
        ("on the road", road, _SAME_M),
    ):
        between = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
        pairs = np.argwhere(np.triu(between < same, k=1))
        if len(pairs):
            i, j = pairs[0]
            raise InputError(
                source,
                f"points {i + 1} and {j + 1} share one place {where}",
                "mend or remove one",
                key="points",
            )
    return road, image


def check_lines(lines: tuple[CalibrationLine, ...], size: tuple[int, int], source: Path) -> Lines:
    """All points of the lines, each with its line's offset, none outside the image."""
    for i, line in enumerate(lines):
        for u, v in line.image:
            if not (0 <= u <= size[0] and 0 <= v <= size[1]):
                raise InputError(
                    source,
                    f"({u:g}, {v:g}) lies outside the {size[0]}×{size[1]} picture",
                    "mend its pixel or the picture's size",
                    key=f"lines.{i}",
                )
    if not lines:
        return Lines.none()
    return Lines(
        np.array([place for line in lines for place in line.image]),
        np.array([line.offset for line in lines for _ in line.image]),
    )


def check_masks(
    masks: Masks, watched: Sequence[Array], size: tuple[int, int], source: Path
) -> list[Array]:
    """Outlines of what must not be looked at, px, each (n, 2), none outside the image, none over a
    watched segment.

    Args:
        watched: the segments' outlines, px.
    """
    found = [np.array(mask) for mask in masks]
    road = polygon_mask(watched if masks else (), size[::-1], 0)
    for i, mask in enumerate(found):
        outside = ((mask < 0) | (mask > size)).any(axis=1)
        if outside.any():
            u, v = mask[outside][0]
            raise InputError(
                source,
                f"({u:g}, {v:g}) lies outside the {size[0]}×{size[1]} picture",
                "mend its pixel or the picture's size",
                key=f"masks.{i}",
            )
        if (polygon_mask([mask], size[::-1], 0) & road).any():
            raise InputError(
                source,
                "covers watched road, whose vehicles would not be seen",
                "draw it beside the road, or the segment smaller",
                key=f"masks.{i}",
            )
    return found


def polygon_mask(
    outlines: Sequence[Array], shape: tuple[int, int], reach: int
) -> npt.NDArray[np.bool_]:
    """Pixels of an image of (height, width) within outlines, or at most `reach` px beside them."""
    mask = np.zeros(shape, dtype=np.uint8)
    for outline in outlines:
        if np.isfinite(outline).all():
            # OpenCV draws with 16-bit coordinates.
            cv2.fillPoly(
                mask, [np.clip(outline, -_MOST_PX, _MOST_PX).round().astype(np.int32)], (1,)
            )
    if reach > 0:
        mask = np.asarray(cv2.dilate(mask, np.ones((2 * reach + 1,) * 2, np.uint8)), dtype=np.uint8)
    return mask.astype(np.bool_)


def fit_points(
    known: Observations, size: tuple[int, int], terms: Sequence[Term], source: Path
) -> Projection:
    """The view of the road that the points and lines fix, checked against the points."""
    try:
        projection = fit_road(known, size, terms)
    except CalibrationError as error:
        worst_point = None if terms else _worst_point(known.road_m, known.image_px, size)
        told = worst_point is not None and worst_point != error.problem
        problem = f"{error.problem} ({worst_point})" if told else error.problem
        raise InputError(source, problem, error.mend, key="points") from None
    check_misses(projection, known, size, source)
    return projection


def check_misses(
    projection: Projection, known: Observations, size: tuple[int, int], source: Path
) -> None:
    """Refuse a fit that misses the points that it was fitted to; the worst of them is named."""
    misses = projection.residuals_px(known.road_m, known.image_px)
    rms = float(np.sqrt(np.mean(misses**2)))
    if not rms <= _MAX_RMS_SHARE * size[0]:
        worst = int(np.argmax(misses))
        worst_point = (
            isinstance(projection, Homography) and _worst_point(known.road_m, known.image_px, size)
        ) or _miss(worst, misses)
        raise InputError(
            source,
            f"the calibration misses its own points by {rms:.1f} px ({worst_point})",
            "check for swapped or mistyped points",
            key="points",
        )


def check_line_misses(
    projection: Projection, lines: Lines, size: tuple[int, int], source: Path
) -> None:
    """Refuse a line that a fit to the points alone contradicts."""
    off = line_misses_px(projection, lines)
    bound = _LINE_TOLERANCE * tolerance_px(size[0])
    if len(off) and not off.max() <= bound:
        offset = lines.offset_m[int(np.argmax(off))]
        by = f"{off.max():.0f} px" if np.isfinite(off.max()) else "more than the picture"
        raise InputError(
            source,
            f"a point of the line at offset {offset:g} m misses it by {by}",
            "check the line's offset and its points",
            key="lines",
        )


def _worst_point(road_m: Array, image_px: Array, size: tuple[int, int]) -> str | None:
    """What contradicts the others, if most agree."""
    try:
        agree = find_inliers(road_m, image_px, tolerance_px(size[0]))
        if agree.all():
            return None
        misses = Homography(road_m[agree], image_px[agree]).residuals_px(road_m, image_px)
    except CalibrationError as error:
        return error.problem
    return _miss(int(np.argmax(np.nan_to_num(misses, nan=np.inf))), misses)


def _miss(point: int, misses: Array) -> str:
    by = f"{misses[point]:.0f} px" if np.isfinite(misses[point]) else "more than the picture"
    return f"point {point + 1} misses by {by}"


def watched_segment(
    segment: SegmentSettings, projection: Projection, size: tuple[int, int], source: Path
) -> WatchedSegment:
    """A segment in its own coordinates.

    Raises:
        InputError: its outline crosses itself, has no area, reaches behind the horizon, is mostly
            outside the image or lies across its direction; its direction has no length.
    """

    def refuse(problem: str, mend: str) -> NoReturn:
        raise InputError(source, problem, mend, key=f"segments.{segment.id}")

    direction = np.array(segment.direction)
    norm = float(np.hypot(*direction))
    if not norm > 1e-9:
        refuse("direction has no length", "give a vector along the road")
    direction /= norm
    polygon = np.array(segment.polygon)
    if len(polygon) > 3 and (polygon[0] == polygon[-1]).all():
        polygon = polygon[:-1]  # closed, as GIS tools write it
    if is_self_intersecting(polygon):
        refuse("polygon crosses itself", "give the corners in order round the outline")
    if area_m2(polygon) < _MIN_AREA_M2:
        refuse("polygon has no area", "give at least three corners that are not on a line")
    if (projection.depth(polygon) <= 1e-6).any():
        refuse("polygon reaches behind the horizon as calibrated", "shorten it or mend the points")
    if not isinstance(projection, Homography):
        back = projection.to_road(projection.to_image(polygon)) - polygon
        if not (np.hypot(back[:, 0], back[:, 1]) <= _MAX_HIDDEN_M).all():
            refuse("polygon reaches behind a crest or the horizon", "shorten it to what is seen")
    seen = visible_share(polygon, projection, size)
    if seen <= 0:
        refuse("polygon lies outside the picture", "give it in road metres, where the camera looks")
    if seen < _MIN_VISIBLE_SHARE:
        refuse(f"only {seen:.0%} of the polygon lies in the picture", "shorten it to what is seen")
    along = polygon @ direction
    across = polygon @ np.array([-direction[1], direction[0]])
    length, width = float(np.ptp(along)), float(np.ptp(across))
    if width > length and width > 2 * segment.lanes * segment.lane_width_m:
        refuse(
            f"polygon is {width:.0f} m wide across its direction and {length:.0f} m long",
            "turn the direction along the road",
        )
    return WatchedSegment(
        segment.id, polygon, direction, length, segment.lanes, segment.lane_width_m
    )


def area_m2(polygon: Array) -> float:
    """Area of a simple polygon (n, 2)."""
    relative = polygon - polygon.mean(axis=0)
    x, y = relative.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def is_self_intersecting(polygon: Array) -> bool:
    """Whether two edges of a polygon (n, 2) that are not neighbours meet."""
    n = len(polygon)
    first, second = np.triu_indices(n, k=2)
    apart = second - first < n - 1
    ends = np.roll(polygon, -1, axis=0)
    a, b = polygon[first[apart]], ends[first[apart]]
    c, d = polygon[second[apart]], ends[second[apart]]

    def side(p: Array, q: Array, r: Array) -> Array:
        (x1, y1), (x2, y2) = (q - p).T, (r - p).T
        return np.asarray(np.sign(x1 * y2 - y1 * x2))

    separate = (side(a, b, c) * side(a, b, d) > 0) | (side(c, d, a) * side(c, d, b) > 0)
    overlap = (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b))
    return bool((~separate & overlap.all(axis=1)).any())


def outline_px(polygon_m: Array, projection: Projection) -> Array:
    """A polygon (n, 2) on the road as it lies in the image, px, shape (m, 2); edges on a curved
    road are followed.
    """
    if isinstance(projection, Homography):
        return projection.to_image(polygon_m)
    share = np.arange(_PIECES)[:, None] / _PIECES
    ends = np.roll(polygon_m, -1, axis=0)
    pieces = [begin + share * (end - begin) for begin, end in zip(polygon_m, ends, strict=True)]
    return projection.to_image(np.concatenate(pieces))


def visible_share(polygon_m: Array, projection: Projection, size: tuple[int, int]) -> float:
    """Share of a polygon's area on the road that lies in the image; all of it before the camera.

    Its image is clipped edge by edge (Sutherland and Hodgman).
    """
    outline = outline_px(polygon_m, projection)
    for axis, sign, limit in ((0, 1, 0), (1, 1, 0), (0, -1, -size[0]), (1, -1, -size[1])):
        inside = sign * outline[:, axis] - limit
        clipped = []
        for i, (point, depth) in enumerate(zip(outline, inside, strict=True)):
            before, other = outline[i - 1], inside[i - 1]
            if (depth >= 0) != (other >= 0):
                clipped.append(before + (point - before) * other / (other - depth))
            if depth >= 0:
                clipped.append(point)
        if not clipped:
            return 0.0
        outline = np.array(clipped)
    return area_m2(projection.to_road(outline)) / area_m2(polygon_m)
