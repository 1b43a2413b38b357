"""camera.toml calibrates the camera that rendered the clip."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from slipstream_lab.simulation.streetdrive.calibration import MonitoredSegment, camera_toml
from slipstream_lab.simulation.streetdrive.clip import ClipRenderer, ClipSettings, draw_clip_camera
from slipstream_lab.simulation.streetdrive.traffic.road import Road


@pytest.mark.long
def test_homography_from_the_file_finds_vehicles_on_the_road(mixed_clip):
    """The fitted homography maps truth's x and y to the renderer's own projection within 1 px."""
    points = mixed_clip.camera["points"]
    road = np.array([p["road"] for p in points])
    homography, _ = cv2.findHomography(road, np.array([p["image"] for p in points]))
    camera = ClipRenderer(ClipSettings(seconds=2.0, fps=15.0, scenario="mixed", seed=7)).camera
    spots = np.array([[r["x_m"], r["y_m"]] for r in mixed_clip.rows if 15 < r["x_m"] < 90])
    mapped = cv2.perspectiveTransform(spots[None], homography)[0]
    projected, _ = camera.project(np.column_stack([spots, np.zeros(len(spots))]))
    assert np.abs(mapped - projected).max() < 1.0


def test_mixed_clip_monitors_both_directions(mixed_clip):
    """Both segments are there with their lanes' strips and unit directions against each other."""
    segments = {s["id"]: s for s in mixed_clip.camera["segments"]}
    assert set(segments) == {"approach", "departure"}
    assert segments["approach"]["direction"] == [-1.0, 0.0]
    assert segments["departure"]["direction"] == [1.0, 0.0]
    for segment in segments.values():
        polygon = np.array(segment["polygon"])
        assert segment["lanes"] == 2
        width = np.ptp(polygon[:, 1])
        assert width == pytest.approx(segment["lanes"] * segment["lane_width_m"])
    sides = [np.mean(np.array(s["polygon"])[:, 1]) for s in segments.values()]
    assert sides[0] > 0 > sides[1]


def test_file_names_image_and_schema(mixed_clip):
    """Schema, name and picture size stand in the file."""
    assert mixed_clip.camera["schema"] == 1
    assert mixed_clip.camera["name"] == "streetdrive-mixed-7"
    assert mixed_clip.camera["image"] == {"width": 1280, "height": 720}


@pytest.mark.parametrize("seed", range(20))
def test_every_drawn_camera_sees_its_segments(seed):
    """Any clip camera gives at least 8 points and has the whole incoming segment in view."""
    road = Road()
    camera = draw_clip_camera(np.random.default_rng([seed, 0]), road)
    segments = ClipSettings(seed=seed).segments
    assert camera_toml("t", camera, road, segments).count("[[points]]") >= 8
    low, high = road.strip_m(-1)
    near, far = segments[0].near_m, segments[0].far_m
    corners = np.array([[x, y, 0.0] for x in (near, far) for y in (low, high)])
    assert camera.sees(camera.project(corners)[0]).all()


def test_reverse_segment_only_where_asked_or_mixed():
    """A stable clip monitors one direction unless a reverse identity is given."""
    assert len(ClipSettings(scenario="stable").segments) == 1
    both = ClipSettings(scenario="stable", reverse_segment_id="back").segments
    assert both[1] == MonitoredSegment("back", 1, both[0].near_m, both[0].far_m)
