"""A real motorway: another model, a calibration by hand, and no truth but what is plausible."""

from __future__ import annotations

from copy import copy
from itertools import permutations
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.camera import Camera, load_camera
from edge_daemon.detection import open_detector
from edge_daemon.offline import TrackResult, track
from edge_daemon.settings import DetectorSettings, TrackSettings
from slipstream_cli.main import main

pytestmark = pytest.mark.long

POINTS = Path(__file__).parent / "data" / "motorway-points.toml"
NEAR_M = (5.0, 55.0)


@pytest.fixture(scope="module")
def camera(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Camera:
    """The clip's, calibrated from its lane dashes."""
    folder = tmp_path_factory.mktemp("motorway")
    clip, file = shared_data / "real_highway_640x360.mp4", folder / "camera.toml"
    places = ["--out", str(file), "--overlay", str(folder / "grid.png")]
    assert main(["calibrate", "--image", str(clip), "--points", str(POINTS), *places]) == 0
    return load_camera(file)


@pytest.fixture(scope="module")
def run(shared_data: Path, camera: Camera) -> TrackResult:
    """The clip, followed with COCO's weights."""
    clip = shared_data / "real_highway_640x360.mp4"
    detector = DetectorSettings(model=str(shared_data / "coco_yolo11n_int8_openvino"))
    # Eleven seconds are one window of ten.
    return track(clip, camera, TrackSettings(window_s=4.0, detector=detector))


@pytest.mark.parametrize("noise", [0.0, 8.0])
def test_the_road_s_part_keeps_what_the_whole_picture_finds(
    shared_data: Path, camera: Camera, noise: float
) -> None:
    """One carriageway takes half of the input; scores may differ by some hundredths."""
    model = str(shared_data / "coco_yolo11n_int8_openvino")
    whole = open_detector(DetectorSettings(model=model))
    road = copy(camera)
    road.segments = camera.segments[1:]
    part = open_detector(DetectorSettings(model=model), road)
    capture = cv2.VideoCapture(str(shared_data / "real_highway_640x360.mp4"))
    chance = np.random.default_rng(1)
    there = kept = 0
    for _ in range(12):
        for _ in range(20):
            ok, picture = capture.read()
        assert ok
        noisy = picture + chance.normal(0, noise, picture.shape)
        image = np.clip(noisy, 0, 255).astype(np.uint8)
        boxes = whole.detect(image).boxes_above(0.5)
        found = part.detect(image).boxes_above(0.45)
        feet = camera.to_road(np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]]))
        on_road = np.any([segment.contains(feet) for segment in road.segments], axis=0)
        for box in boxes[on_road]:
            there += 1
            kept += bool((np.abs(found - box).max(axis=1, initial=0.0) < 4).any())
    capture.release()
    assert there >= 8
    assert kept >= 0.98 * there


def test_speeds_are_those_of_a_motorway(run: TrackResult) -> None:
    """113 km/h are allowed: the slow lanes keep to it, the fast ones nearly."""
    speeds: dict[int, list[float]] = {}
    for who, _, speed_mps, _ in run.recorder.speeds:
        speeds.setdefault(who, []).append(3.6 * speed_mps)
    medians = [np.median(of_one) for of_one in speeds.values() if len(of_one) >= 10]
    assert len(medians) >= 6
    assert 88 < min(medians) < 100
    assert 105 < max(medians) < 122


def test_near_vehicles_keep_their_identity(run: TrackResult) -> None:
    """No track of a third of a second begins where another one, last seen in the near half just
    before, would be by then.
    """
    paths: dict[int, list[tuple[float, float, float]]] = {}
    for sightings in run.recorder.sightings:
        for who, at_s, (x, y) in zip(
            sightings.track, sightings.time_s, sightings.point_m, strict=True
        ):
            paths.setdefault(int(who), []).append((float(at_s), float(x), float(y)))
    whole = [np.array(path) for path in paths.values() if len(path) >= 10]
    near = [path for path in whole if (path[:, 1] < NEAR_M[1]).any()]
    assert len(near) >= 5
    switches = []
    for before, after in permutations(near, 2):
        end_s, x, y = before[-1]
        gap_s = after[0, 0] - end_s
        speed = np.polyfit(before[-10:, 0], before[-10:, 1], 1)[0]
        there = abs(x + speed * gap_s - after[0, 1]) < 8 and abs(y - after[0, 2]) < 1.5
        if 0 < gap_s < 2 and there and NEAR_M[0] < x < NEAR_M[1]:
            switches.append((end_s, x, y))
    assert switches == []
