"""A real motorway: another model, a calibration by hand, and no truth but what is plausible."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from edge_daemon.camera import load_camera
from edge_daemon.offline import TrackResult, track
from edge_daemon.settings import DetectorSettings, TrackSettings
from slipstream_cli.main import main

pytestmark = pytest.mark.slow(long=True)

POINTS = Path(__file__).parent / "data" / "motorway-points.toml"
NEAR_M = (5.0, 55.0)


@pytest.fixture(scope="module")
def run(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> TrackResult:
    """The clip, calibrated from its lane dashes, followed with COCO's weights."""
    folder = tmp_path_factory.mktemp("motorway")
    clip, camera = shared_data / "real_highway_640x360.mp4", folder / "camera.toml"
    places = ["--out", str(camera), "--overlay", str(folder / "grid.png")]
    assert main(["calibrate", "--image", str(clip), "--points", str(POINTS), *places]) == 0
    detector = DetectorSettings(model=str(shared_data / "coco_yolo11n_int8_openvino"))
    # Eleven seconds are one window of ten.
    return track(clip, load_camera(camera), TrackSettings(window_s=4.0, detector=detector))


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
