"""What a person should look at in a calibration, a sentence each."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera.checks import visible_share
from edge_daemon.camera.curved import CurvedRoad
from edge_daemon.camera.fit import Projection
from edge_daemon.camera.homography import Array
from edge_daemon.camera.pose import CameraPose
from edge_daemon.camera.segment import WatchedSegment

MAX_SPEED_ERROR: Final = 0.03
_MIN_VISIBLE_SHARE: Final = 0.95
_WIDTH_FACTOR: Final = 1.5
_PLAUSIBLE_HEIGHT_M: Final = (2.5, 80.0)
_MAX_ARC_ERROR: Final = 0.01


@dataclass(frozen=True)
class EndAccuracy:
    """How well one end of a segment is measured; both errors come from the clicks, and are infinite
    where such clicks put the end beyond the horizon.

    Attributes:
        end: the end nearer to or farther from the camera.
        point_m: the middle of that end.
        metres_per_px: along the direction of travel, for a pixel in the worst direction.
        position_error_m: standard error of a position along the direction.
        speed_error: relative standard error of a speed along the direction.
    """

    segment: str
    end: str
    point_m: tuple[float, float]
    metres_per_px: float
    position_error_m: float
    speed_error: float

    @property
    def is_sure(self) -> bool:
        """Whether errors can be stated."""
        return math.isfinite(self.position_error_m) and math.isfinite(self.speed_error)

    def as_json(self) -> dict[str, Any]:
        """Its attributes; JSON has no infinity: None."""
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in asdict(self).items()
        }


def warnings_of(
    misses_px: Array,
    used: npt.NDArray[np.bool_],
    pose: CameraPose | None,
    segments: tuple[WatchedSegment, ...],
    projection: Projection,
    size: tuple[int, int],
    accuracy: tuple[EndAccuracy, ...],
    click_px: float,
) -> tuple[str, ...]:
    """All of them; arguments are those of a `Calibration`."""
    return (
        *_about_points(misses_px, used),
        *_about_pose(pose),
        *_about_outlines(segments, projection, size),
        *_about_arc(segments, projection),
        *_about_accuracy(accuracy, click_px),
    )


def _about_points(misses: Array, used: npt.NDArray[np.bool_]) -> list[str]:
    said = []
    for i in np.flatnonzero(~used):
        by = (
            f"misses by {misses[i]:.0f} px" if np.isfinite(misses[i]) else "lies beyond the horizon"
        )
        said.append(f"point {i + 1} {by} and is left out: check its pixel and its road coordinates")
    if used.sum() == 4:
        said.append("four points fit any calibration: a fifth and sixth would show mistakes")
    return said


def _about_pose(pose: CameraPose | None) -> list[str]:
    if pose is None:
        return [
            "no plain camera has this view: wrong distances, a cropped or distorted picture, or a "
            "road that is not flat"
        ]
    low, high = _PLAUSIBLE_HEIGHT_M
    if not low <= pose.height_m <= high:
        return [
            f"the points put the camera {pose.height_m:.1f} m above the road: check the distances"
        ]
    return []


def _about_outlines(
    segments: tuple[WatchedSegment, ...], projection: Projection, size: tuple[int, int]
) -> list[str]:
    said = []
    for segment in segments:
        seen = visible_share(segment.polygon_m, projection, size)
        if seen < _MIN_VISIBLE_SHARE:
            said.append(
                f"segment {segment.id}: only {seen:.0%} of it is in the picture, so its density "
                "comes out low"
            )
        across = segment.polygon_m @ segment.left
        lanes_m = segment.lanes * segment.lane_width_m
        if not 1 / _WIDTH_FACTOR <= np.ptp(across) / lanes_m <= _WIDTH_FACTOR:
            said.append(
                f"segment {segment.id}: its outline is {np.ptp(across):.1f} m wide, its lanes "
                f"{lanes_m:.1f} m"
            )
    for one, other in combinations(segments, 2):
        shared = overlap_m2(one, other)
        if shared > 1.0:
            said.append(
                f"segments {one.id} and {other.id} overlap by {shared:.0f} m²: vehicles there "
                "count in both"
            )
    return said


def _about_arc(segments: tuple[WatchedSegment, ...], projection: Projection) -> list[str]:
    if not isinstance(projection, CurvedRoad):
        return []
    said = []
    for segment in segments:
        off = float(np.abs(projection.curvature_per_m * segment.polygon_m[:, 1]).max())
        if off > _MAX_ARC_ERROR:
            said.append(
                f"segment {segment.id}: stations are measured at y = 0, and at its edges the arc "
                f"is {off:.1%} shorter or longer, as are speeds there: put y = 0 in its middle"
            )
    return said


def _about_accuracy(accuracy: tuple[EndAccuracy, ...], click_px: float) -> list[str]:
    said = []
    for end in accuracy:
        if end.is_sure and end.speed_error <= MAX_SPEED_ERROR:
            continue
        sure = f"are unsure by {end.speed_error:.1%}" if end.is_sure else "cannot be measured"
        said.append(
            f"segment {end.segment}: speeds at its {end.end} end {sure} with clicks "
            f"{click_px:.1f} px off: add points there"
        )
    return said


def overlap_m2(one: WatchedSegment, other: WatchedSegment) -> float:
    """Area that two outlines share, by counting points of a grid."""
    low = np.maximum(one.polygon_m.min(axis=0), other.polygon_m.min(axis=0))
    high = np.minimum(one.polygon_m.max(axis=0), other.polygon_m.max(axis=0))
    if not (high > low).all():
        return 0.0
    steps = 100
    x, y = (low + (np.arange(steps)[:, None] + 0.5) / steps * (high - low)).T
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    both = one.contains(grid) & other.contains(grid)
    return float(both.mean() * np.prod(high - low))
