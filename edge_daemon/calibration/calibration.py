"""From points clicked in an image to a camera's calibration, and how well it measures: errors of
positions and speeds are found by moving each click by itself and fitting again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.calibration.advice import EndAccuracy, warnings_of
from edge_daemon.camera import Camera
from edge_daemon.camera.checks import (
    check_line_misses,
    check_lines,
    check_misses,
    check_points,
    watched_segment,
)
from edge_daemon.camera.fit import (
    Observations,
    Projection,
    fit_road,
    parameter_count,
)
from edge_daemon.camera.homography import Array, CalibrationError, Lines
from edge_daemon.camera.pose import CameraPose, pose_of
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.camera.selection import choose_road
from edge_daemon.settings import (
    CalibrationLine,
    CalibrationPoint,
    CameraSettings,
    SegmentSettings,
    Term,
)
from slipstream.config import load
from slipstream.errors import InputError
from slipstream.messages import CameraCalibration

CLICK_PX: Final = 1.0
_MAX_CONTRADICTING: Final = 0.2
_END: Final = 1 / 3
_MIN_WIDTH_M: Final = 0.5


@dataclass(frozen=True)
class Calibration:
    """A fitted camera.

    Attributes:
        size: (width, height) of its images, px.
        used: which of the n points the fit rests on; the others contradict them.
        reprojection_error_px: root mean square of those used.
        click_px: standard error of a clicked point that the accuracy is stated for: 1 px, or the
            estimate from the residuals where that is larger.
        terms: what the fit has beyond a plane and a pinhole.
        pose: where the camera hangs, if it is a plain one.
        accuracy: at both ends of each segment.
        warnings: what a person should look at, a sentence each.
    """

    size: tuple[int, int]
    road_m: Array
    image_px: Array
    used: npt.NDArray[np.bool_]
    residuals_px: Array
    reprojection_error_px: float
    click_px: float
    projection: Projection
    terms: tuple[Term, ...]
    lines: tuple[CalibrationLine, ...]
    pose: CameraPose | None
    segments: tuple[WatchedSegment, ...]
    accuracy: tuple[EndAccuracy, ...]
    warnings: tuple[str, ...]


def calibrate(
    points: tuple[CalibrationPoint, ...],
    segments: tuple[SegmentSettings, ...],
    size: tuple[int, int],
    source: Path,
    lines: tuple[CalibrationLine, ...] = (),
    terms: tuple[Term, ...] | None = None,
) -> Calibration:
    """Fit a camera of (width, height) to four points or more; those that contradict most others are
    left out and named. Without `terms` the model has those that the points ask for; `source` is the
    points' file, for error lines.

    Raises:
        InputError: what `edge_daemon.camera.load_camera` would refuse; more than a fifth of the
            points contradict the others, or several at one end and none elsewhere.
    """
    road, image = check_points(points, size, source)
    known = Observations(road, image, check_lines(lines, size, source))
    try:
        # One row of dashes fixes no width: lines have to help then.
        narrow = float(np.ptp(road[:, 1])) < _MIN_WIDTH_M
        alone = known if narrow else replace(known, lines=Lines.none())
        projection, chosen, used = choose_road(alone, size, terms)
        check_line_misses(projection, known.lines, size, source)
        # As a file with the points left out will be read.
        projection = fit_road(known.only(used), size, chosen)
    except CalibrationError as error:
        raise InputError(source, error.problem, error.mend, key="points") from None
    _check_contradictions(road, used, source)
    check_misses(projection, known.only(used), size, source)
    misses = projection.residuals_px(road, image)
    ids = [segment.id for segment in segments]
    if len(set(ids)) < len(ids):
        raise InputError(source, "two segments with one id", "rename one", key="segments.id")
    outlines = tuple(watched_segment(segment, projection, size, source) for segment in segments)
    rms = float(np.sqrt(np.mean(misses[used] ** 2)))
    click_px = max(CLICK_PX, click_error_px(misses[used], chosen))
    pose = pose_of(projection, size)
    accuracy = tuple(accuracy_of(projection, known.only(used), size, chosen, outlines, click_px))
    warnings = warnings_of(misses, used, pose, outlines, projection, size, accuracy, click_px)
    return Calibration(
        size,
        road,
        image,
        used,
        misses,
        rms,
        click_px,
        projection,
        chosen,
        lines,
        pose,
        outlines,
        accuracy,
        warnings,
    )


def _check_contradictions(road_m: Array, used: npt.NDArray[np.bool_], source: Path) -> None:
    wrong = np.flatnonzero(~used)
    names = ", ".join(str(i + 1) for i in wrong)
    if len(wrong) > _MAX_CONTRADICTING * len(used):
        raise InputError(
            source,
            f"{len(wrong)} of {len(used)} points contradict the others: {names}",
            "check their coordinates, or leave them out",
            key="points",
        )
    if len(wrong) < 2:
        return
    spread = np.linalg.svd(road_m - road_m.mean(axis=0), full_matrices=False)[2][0]
    rank = np.argsort(np.argsort(road_m @ spread)) / (len(road_m) - 1)
    if (rank[wrong] <= _END).all() or (rank[wrong] >= 1 - _END).all():
        raise InputError(
            source,
            f"all points that contradict the others lie at one end of the road: {names}",
            "check their coordinates and whether the road is as assumed there, or leave them out",
            key="points",
        )


def stated_calibration(path: Path, camera: Camera) -> CameraCalibration:
    """How well a camera calibrated by the camera.toml measures, for its health messages."""
    settings = load(path, CameraSettings)
    road, image = check_points(settings.points, camera.size, path)
    known = Observations(road, image, check_lines(settings.lines, camera.size, path))
    misses = camera.projection.residuals_px(road, image)
    click_px = max(CLICK_PX, click_error_px(misses, settings.terms))
    ends = accuracy_of(
        camera.projection, known, camera.size, settings.terms, camera.segments, click_px
    )
    worst = max((end.speed_error for end in ends), default=np.inf)
    return CameraCalibration(
        file=str(path),
        written_ns=path.stat().st_mtime_ns,
        points=len(road),
        residual_px=camera.reprojection_error_px,
        speed_error=worst if np.isfinite(worst) else None,
    )


def click_error_px(residuals_px: Array, terms: tuple[Term, ...] = ()) -> float:
    """Standard error of a clicked coordinate, estimated from n residuals; 0 for n = 4."""
    freedom = 2 * len(residuals_px) - parameter_count(terms)
    return float(np.sqrt(np.sum(residuals_px**2) / freedom)) if freedom > 0 else 0.0


def accuracy_of(
    projection: Projection,
    known: Observations,
    size: tuple[int, int],
    terms: tuple[Term, ...],
    segments: tuple[WatchedSegment, ...],
    click_px: float,
) -> list[EndAccuracy]:
    """What clicks that are ``click_px`` off in each coordinate do at both ends of each segment.

    A vehicle that truly moves by v·dt along the direction d moves in the image by J·d·v·dt, J
    the true derivative of the image by the road; another fit, with J' from image to road, takes
    its speed for v·dᵀJ'J·d.
    """
    ends = [(s, end, point) for s in segments for end, point in _ends(s, projection)]
    if not ends:
        return []
    places = np.stack([point for _, _, point in ends])
    directions = np.stack([segment.direction for segment, _, _ in ends])
    pixels = projection.to_image(places)
    _, to_road = projection.to_road_with_jacobian(pixels)
    flow = np.einsum("nij,nj->ni", np.linalg.inv(to_road), directions)
    shift = np.zeros(len(ends))
    stretch = np.zeros(len(ends))
    for point in range(len(known.image_px)):
        for axis in (0, 1):
            moved = known.image_px.copy()
            moved[point, axis] += click_px
            try:
                other = fit_road(replace(known, image_px=moved), size, terms, projection)
            except CalibrationError:
                return [_end(*end, to_road[i], np.inf, np.inf) for i, end in enumerate(ends)]
            seen, derivative = other.to_road_with_jacobian(pixels)
            shift += np.einsum("ni,ni->n", directions, seen - places) ** 2
            speed = np.einsum("ni,nij,nj->n", directions, derivative, flow)
            stretch += (speed - 1) ** 2
    # NaN: a click so far off puts the end beyond the horizon.
    shift, stretch = (np.nan_to_num(np.sqrt(sum_), nan=np.inf) for sum_ in (shift, stretch))
    return [
        _end(*end, to_road[i], float(shift[i]), float(stretch[i])) for i, end in enumerate(ends)
    ]


def _end(
    segment: WatchedSegment, end: str, point: Array, to_road: Array, shift: float, stretch: float
) -> EndAccuracy:
    per_px = float(np.hypot(*(segment.direction @ to_road)))
    place = (float(point[0]), float(point[1]))
    return EndAccuracy(segment.id, end, place, per_px, shift, stretch)


def _ends(segment: WatchedSegment, projection: Projection) -> list[tuple[str, Array]]:
    """The middles of the outline's ends, nearer first."""
    along = segment.along(segment.polygon_m) - segment.begin_m
    begin = segment.polygon_m[along <= 0.1 * segment.length_m].mean(axis=0)
    finish = segment.polygon_m[along >= 0.9 * segment.length_m].mean(axis=0)
    depths = projection.depth(np.stack([begin, finish]))
    near, far = (begin, finish) if depths[0] <= depths[1] else (finish, begin)
    return [("near", near), ("far", far)]
