"""Clips are reproducible, and their truth agrees with itself and with the pictures."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive import ClipSettings, render_clip
from slipstream_lab.simulation.streetdrive.clip import TRUTH_COLUMNS, ClipRenderer
from slipstream_lab.simulation.streetdrive.vehicles.catalogue import CLASSES

FILES = ("video.mp4", "truth.csv", "camera.toml")


def by_vehicle(rows: list[dict[str, Any]]) -> dict[float, list[dict[str, Any]]]:
    """Rows of each vehicle in the order of frames."""
    tracks = defaultdict(list)
    for row in rows:
        tracks[row["vehicle_id"]].append(row)
    return tracks


@pytest.mark.long
def test_same_seed_gives_the_same_bytes_on_any_thread_count(tmp_path, mixed_clip):
    """Video, truth and calibration are equal byte for byte when rendered again with one thread."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        render_clip(ClipSettings(seconds=2.0, fps=15.0, scenario="mixed", seed=7), tmp_path)
    finally:
        cv2.setNumThreads(threads)
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (mixed_clip.folder / name).read_bytes(), name
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(FILES)


def test_video_has_the_promised_frames(mixed_clip):
    """The video decodes to 30 pictures of 1280 x 720 at 15 frames per second."""
    capture = cv2.VideoCapture(str(mixed_clip.folder / "video.mp4"))
    count = 0
    while True:
        ok, image = capture.read()
        if not ok:
            break
        assert image.shape == (720, 1280, 3)
        count += 1
    assert count == 30
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(15.0)


def test_truth_has_the_promised_columns_and_classes(mixed_clip):
    """The header is the documented one, and more than one class drives by."""
    header = (mixed_clip.folder / "truth.csv").read_text().splitlines()[0]
    assert tuple(header.split(",")) == TRUTH_COLUMNS
    classes = {row["class"] for row in mixed_clip.rows}
    assert classes <= set(CLASSES)
    assert len(classes) >= 2


@pytest.mark.long
@pytest.mark.parametrize("clip_name", ["mixed_clip", "paper_clip"])
def test_truth_is_consistent_in_time(clip_name, request):
    """Speed is the change of x over time, and acceleration the change of speed."""
    clip = request.getfixturevalue(clip_name)
    speed_errors, acceleration_errors = [], []
    for rows in by_vehicle(clip.rows).values():
        for a, b in pairwise(rows):
            if b["frame"] != a["frame"] + 1:
                continue
            dt = b["time_s"] - a["time_s"]
            sign = -1.0 if a["y_m"] > 0 else 1.0
            mean_speed = (a["speed_mps"] + b["speed_mps"]) / 2
            speed_errors.append(sign * (b["x_m"] - a["x_m"]) / dt - mean_speed)
            mean = (a["acceleration_mps2"] + b["acceleration_mps2"]) / 2
            acceleration_errors.append((b["speed_mps"] - a["speed_mps"]) / dt - mean)
    assert len(speed_errors) > 100
    assert np.abs(speed_errors).max() < 0.06
    # Drivers may hit the brakes between two frames, so a few steps jump.
    assert np.median(np.abs(acceleration_errors)) < 0.02
    assert np.quantile(np.abs(acceleration_errors), 0.98) < 0.5


@pytest.mark.long
def test_boxes_lie_inside_the_picture_and_around_the_vehicle(mixed_clip):
    """The projected footprint lies in the box, but for what the picture's edge cuts off."""
    camera = ClipRenderer(ClipSettings(seconds=2.0, fps=15.0, scenario="mixed", seed=7)).camera
    whole = 0
    for row in mixed_clip.rows:
        x1, y1, x2, y2 = (row[k] for k in ("x1_px", "y1_px", "x2_px", "y2_px"))
        assert 0 <= x1 < x2 <= 1280
        assert 0 <= y1 < y2 <= 720
        assert 0 <= row["visible_fraction"] <= 1
        half = np.array([row["length_m"], row["width_m"]]) / 2
        # Tyres stop a little short of the bumpers, so the corners shrink to their contact area.
        corners = np.array([[a, b] for a in (-0.5, 0.5) for b in (-0.7, 0.7)]) * half
        ground = np.column_stack([corners + np.array([row["x_m"], row["y_m"]]), np.zeros(4)])
        pixels, depth = camera.project(ground)
        if depth.min() > 1 and camera.sees(pixels, 1.0).all() and x2 < 1279 and y2 < 719 and x1 > 1:
            whole += 1
            assert x1 - 1 <= pixels[:, 0].min() <= pixels[:, 0].max() <= x2 + 1
            assert y1 - 1 <= pixels[:, 1].min() <= pixels[:, 1].max() <= y2 + 1
            assert y2 - pixels[:, 1].max() < 0.25 * (y2 - y1) + 1
    assert whole > 300


def test_vehicles_are_drawn_where_truth_says(mixed_clip):
    """Between two pictures 1 s apart, boxes of moving vehicles change and the sky does not."""
    capture = cv2.VideoCapture(str(mixed_clip.folder / "video.mp4"))
    pictures = [capture.read()[1].astype(np.int16) for _ in range(16)]
    change = np.abs(pictures[15] - pictures[0]).max(axis=2)
    moving = [
        row
        for row in mixed_clip.rows
        if row["frame"] == 0
        and row["speed_mps"] > 8
        and row["visible_fraction"] > 0.6
        and row["y2_px"] - row["y1_px"] > 30
        and row["y2_px"] < 700
    ]
    assert len(moving) >= 3
    for row in moving:
        x1, y1, x2, y2 = (int(row[k]) for k in ("x1_px", "y1_px", "x2_px", "y2_px"))
        assert np.mean(change[y1:y2, x1:x2] > 25) > 0.4
    assert np.mean(change[:60] > 25) < 0.01


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"seconds": 0.0}, "seconds"),
        ({"seconds": float("nan")}, "seconds"),
        ({"fps": 1000.0}, "fps"),
        ({"scenario": "rain"}, "scenario"),
        ({"seed": -1}, "seed"),
        ({"segment_id": "a/b"}, "segment_id"),
        ({"reverse_segment_id": "approach"}, "reverse_segment_id"),
    ],
)
def test_settings_out_of_range_are_refused(change, key):
    """A wrong setting raises InputError that names its key."""
    with pytest.raises(InputError) as caught:
        replace(ClipSettings(), **change)
    assert caught.value.key == key


def test_unwritable_folder_is_refused(tmp_path: Path):
    """A file where the folder should be raises InputError."""
    blocker = tmp_path / "file"
    blocker.write_text("")
    with pytest.raises(InputError):
        render_clip(ClipSettings(seconds=0.2), blocker / "clip")
