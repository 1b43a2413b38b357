"""From boxes to road points."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.camera import Camera
from edge_daemon.detection import Detections
from edge_daemon.tracking.measurement import RoadPoints, to_road_points

from ..conftest import project


def measured(camera: Camera, boxes: list[tuple[float, float, float, float]]) -> RoadPoints:
    """Road points of boxes."""
    n = len(boxes)
    return to_road_points(
        Detections(
            np.array(boxes, dtype=np.float32).reshape(-1, 4),
            np.full(n, 0.9, dtype=np.float32),
            np.zeros(n, dtype=np.int64),
        ),
        camera,
    )


def standing_at(x_m: float, y_m: float, size_px: float = 40) -> tuple[float, float, float, float]:
    """A box whose lower edge's middle is a road point."""
    u, v = project([[x_m, y_m]])[0]
    return float(u - size_px / 2), float(v - size_px), float(u + size_px / 2), float(v)


def test_a_box_stands_on_the_road_where_its_lower_edge_is(camera: Camera) -> None:
    """The middle of the lower edge, not of the box."""
    found = measured(camera, [standing_at(40.0, 3.0)])
    assert found.points_m[0] == pytest.approx((40.0, 3.0), abs=0.01)


def test_far_boxes_are_less_certain_and_most_along_the_road(camera: Camera) -> None:
    """A pixel at 80 m is worth more metres than at 25 m, above all in depth."""
    near, far = measured(camera, [standing_at(25.0, 3.0), standing_at(80.0, 3.0)]).covariances_m2
    assert far[0, 0] > 20 * near[0, 0]
    assert far[0, 0] > 10 * far[1, 1]
    assert np.linalg.eigvalsh(near).min() > 0


def test_a_covered_vehicle_counts_less(camera: Camera) -> None:
    """A vehicle behind another one keeps its track, but its position weighs little."""
    alone = measured(camera, [standing_at(40.0, 3.0)]).covariances_m2[0]
    x1, _, x2, v = standing_at(40.0, 3.0)
    behind = measured(camera, [standing_at(40.0, 3.0), (x1 - 5, v - 30, x2 + 5, v + 20)])
    assert behind.covariances_m2[0, 0, 0] > 9 * alone[0, 0]
    side = measured(camera, [standing_at(40.0, 3.0), (x2 + 1, v - 30, x2 + 60, v + 20)])
    assert side.covariances_m2[0] == pytest.approx(alone)


def test_a_doubted_box_counts_less(camera: Camera) -> None:
    """Low scores come with boxes that are off by a share of their size."""
    box = np.array([standing_at(40.0, 3.0)] * 2, dtype=np.float32)
    scores = np.array([0.9, 0.3], dtype=np.float32)
    found = to_road_points(Detections(box, scores, np.zeros(2, dtype=np.int64)), camera)
    assert found.covariances_m2[1, 0, 0] > 9 * found.covariances_m2[0, 0, 0]


def test_away_points_from_the_camera(camera: Camera) -> None:
    """The pole stands at the origin: what it sees, it sees along the line from there."""
    found = measured(camera, [standing_at(40.0, 3.0), standing_at(60.0, -4.0)])
    expected = found.points_m / np.linalg.norm(found.points_m, axis=1, keepdims=True)
    assert found.away == pytest.approx(expected, abs=0.02)


def test_boxes_cut_off_by_the_picture_or_in_the_sky_are_left_out(camera: Camera) -> None:
    """Where the lower edge is not seen, there is no position."""
    found = measured(
        camera,
        [
            standing_at(40.0, 3.0),
            (600, 650, 700, 720),
            (0, 300, 60, 380),
            (1240, 300, 1280, 380),
            (600, 2, 640, 20),
        ],
    )
    assert len(found.points_m) == 1
    assert len(found.boxes) == len(found.scores) == len(found.classes) == 1
    assert len(measured(camera, []).points_m) == 0
