"""Writes camera.toml: what the edge daemon needs to know about a StreetDrive camera."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import PinholeCamera
from slipstream_lab.simulation.streetdrive.traffic import Road

Point = tuple[float, float]


@dataclass(frozen=True)
class MonitoredSegment:
    """A stretch of road that the camera watches; direction is -1 (incoming) or +1 (outgoing)."""

    segment_id: str
    direction: int
    near_m: float
    far_m: float


def correspondences(camera: PinholeCamera, road: Road, far_m: float) -> list[tuple[Point, Point]]:
    """Pairs of (pixel, road point), 8 to 12 of them, spread over the part of the road in view."""
    left, right = road.strip_m(-1)[1], road.strip_m(1)[0]
    pairs: list[tuple[Point, Point]] = []
    for x in np.geomspace(14.0, far_m + 10.0, 6):
        for y in (left, right):
            road_point = (round(float(x), 2), round(float(y), 2))
            pixels, _ = camera.project(np.array([[*road_point, 0.0]]))
            if bool(camera.sees(pixels, 2.0)[0]):
                pairs.append(((float(pixels[0, 0]), float(pixels[0, 1])), road_point))
    return pairs


def strip_polygon(road: Road, segment: MonitoredSegment) -> list[Point]:
    """Corners of a monitored segment on the road plane, in metres."""
    low, high = road.strip_m(segment.direction)
    near, far = segment.near_m, segment.far_m
    return [(near, low), (far, low), (far, high), (near, high)]


@dataclass(frozen=True)
class SegmentText:
    """One `[[segments]]` table."""

    segment_id: str
    polygon_m: Sequence[Point]
    direction: str
    lanes: int
    lane_width_m: float


def camera_toml(
    name: str, camera: PinholeCamera, road: Road, segments: Sequence[MonitoredSegment]
) -> str:
    """The file's text; equal arguments give equal text."""
    return calibration_text(
        "a StreetDrive camera",
        name,
        camera,
        correspondences(camera, road, max(s.far_m for s in segments)),
        [
            SegmentText(
                segment.segment_id,
                strip_polygon(road, segment),
                f"{float(segment.direction):.1f}, 0.0",
                road.incoming_lanes if segment.direction < 0 else road.outgoing_lanes,
                road.lane_width_m,
            )
            for segment in segments
        ],
    )


def calibration_text(
    what: str,
    name: str,
    camera: PinholeCamera,
    points: Sequence[tuple[Point, Point]],
    segments: Sequence[SegmentText],
) -> str:
    """A camera.toml from pairs of (pixel, road point) and segments on the road plane."""
    lines = [
        f"# Calibration of {what}: pixels (origin top-left) and the road plane (m).",
        "schema = 1",
        f"name = {_quoted(name)}",
        "",
        "[image]",
        f"width = {camera.width_px}",
        f"height = {camera.height_px}",
    ]
    for (u, v), (x, y) in points:
        lines += [
            "",
            "[[points]]",
            f"image = [{u:.4f}, {v:.4f}]",
            f"road = [{x:.2f}, {y:.2f}]",
        ]
    for segment in segments:
        corners = ", ".join(f"[{x:.2f}, {y:.2f}]" for x, y in segment.polygon_m)
        lines += [
            "",
            "[[segments]]",
            f"id = {_quoted(segment.segment_id)}",
            f"polygon = [{corners}]",
            f"direction = [{segment.direction}]",
            f"lanes = {segment.lanes}",
            f"lane_width_m = {segment.lane_width_m:.2f}",
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A TOML basic string: JSON's escapes are among TOML's, but for the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
