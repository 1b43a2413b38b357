"""The benchmark of real roads, on a set that the test makes in the published form."""

from __future__ import annotations

import gzip
import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from edge_daemon.camera.homography import Array, Homography
from edge_daemon.camera.pose import CameraPose, pose_of
from slipstream.errors import InputError
from slipstream_lab.benchmarks.real.__main__ import LABELS, main
from slipstream_lab.benchmarks.real.boxes import load_labels, score_boxes
from slipstream_lab.benchmarks.real.brno import SIZE, find_recordings, load_recording
from slipstream_lab.benchmarks.real.cameras import distance_errors, from_survey
from slipstream_lab.benchmarks.real.score import figures, match, point_height_m
from slipstream_lab.benchmarks.real.speeds import counted, measure, without_stalled_ends

FPS = 50.0
GATES_M = (44.0, 16.0)
LANES_M = (-3.5, 0.0, 3.5)
HEIGHT_M, FOCAL_PX, TILT = 10.0, 2000.0, 0.45


def camera() -> CameraPose:
    """A camera 10 m over a straight road, looking along it."""
    road = np.array([(x, y) for x in (15.0, 30.0, 45.0) for y in (-4.0, 0.0, 4.0)])
    ahead = np.cos(TILT) * road[:, 0] + np.sin(TILT) * HEIGHT_M
    below = np.cos(TILT) * HEIGHT_M - np.sin(TILT) * road[:, 0]
    image = np.column_stack([-road[:, 1], below]) / ahead[:, None] * FOCAL_PX + np.array(SIZE) / 2
    pose = pose_of(Homography(road, image), SIZE)
    assert pose is not None
    return pose


def seen(road_m: Array, height_m: float = 0.0) -> Array:
    """Pixels of road points, or of points over them."""
    return camera().project(np.column_stack([road_m, np.full(len(road_m), height_m)]))


def line(points_px: Array) -> Array:
    """Homogeneous line through two pixels."""
    return np.cross(*np.column_stack([points_px, np.ones(2)]))


def write_set(
    folder: Path, name: str = "session9_left", raised_m: float = 0.0, seed: int = 1, count: int = 30
) -> None:
    """Vehicles of constant speeds, one every three seconds, in two lanes."""
    rng = np.random.default_rng(seed)
    speeds = rng.uniform(50.0, 90.0, count)
    passages, tracks = [], []
    for number, kmh in enumerate(speeds):
        lane = number % 2
        enters_s = 2.0 + 3.0 * number
        way = kmh / 3.6
        frames = np.arange(int(enters_s * FPS), int((enters_s + 34.0 / way) * FPS))
        x = 50.0 - way * (frames / FPS - enters_s)
        y = np.full(len(x), LANES_M[lane] + 1.75)
        pixels = seen(np.column_stack([x, y]), raised_m) + rng.normal(0, 0.4, (len(x), 2))
        ok = (pixels[:, 1] > 0) & (pixels[:, 1] < SIZE[1])
        tracks.append(
            {
                "id": number,
                "frames": frames[ok].tolist(),
                "posX": pixels[ok, 0].tolist(),
                "posY": pixels[ok, 1].tolist(),
            }
        )
        ends = [enters_s + (50.0 - gate) / way for gate in GATES_M]
        passages.append(
            {
                "laneIndex": {lane},
                "carId": number,
                "valid": number != 3,
                "speed": float(kmh),
                "intersections": [
                    {"measurementLineId": 1, "videoTime": ends[0]},
                    {"measurementLineId": 0, "videoTime": ends[1]},
                ],
            }
        )
    corners = [(GATES_M[0], -4.0), (GATES_M[1], -4.0), (GATES_M[1], 4.0), (GATES_M[0], 4.0)]
    pairs = [(0, 1, True), (3, 2, True), (0, 3, False), (1, 2, False)]
    distances = []
    for begin, end, along in pairs:
        a, b = (np.array([corners[i]]) for i in (begin, end))
        px = [np.append(seen(point)[0], 1.0) for point in (a, b)]
        distances.append(
            {"p1": px[0], "p2": px[1], "distance": float(np.hypot(*(b - a)[0])), "toVP1": along}
        )
    truth = {
        "distanceMeasurement": distances,
        "measurementLines": [
            line(seen(np.array([(gate, -4.0), (gate, 4.0)]))) for gate in reversed(GATES_M)
        ],
        "laneDivLines": [
            line(seen(np.array([(side_x, side) for side_x in GATES_M]))) for side in LANES_M
        ],
        "cars": passages,
        "fps": FPS,
        "invalidLanes": set(),
    }
    with np.printoptions(precision=12):
        text = repr(truth).replace("np.float64(", "(").replace("set()", "set([])")
    folder.mkdir(parents=True, exist_ok=True)
    for lane in (0, 1):
        text = text.replace(f"{{{lane}}}", f"set([{lane}])")
    (folder / f"{name}_truth.txt.gz").write_bytes(gzip.compress(text.encode()))
    data = {"camera_calibration": {}, "cars": tracks}
    (folder / f"{name}_tracks.json.gz").write_bytes(gzip.compress(json.dumps(data).encode()))


def test_a_surveyed_camera_gives_true_speeds(tmp_path: Path) -> None:
    """Focal length, height and speeds come out; the invalid passage counts nowhere."""
    write_set(tmp_path)
    ((truth, tracks),) = find_recordings(tmp_path)
    recording = load_recording(truth, tracks)
    surveyed = from_survey(recording)
    pose = surveyed.camera.pose
    assert pose is not None
    assert pose.focal_px == pytest.approx(FOCAL_PX, rel=0.02)
    assert surveyed.height_m == pytest.approx(HEIGHT_M, rel=0.01)
    assert np.abs(distance_errors(recording, surveyed)).max() < 0.002
    assert 0.0005 < surveyed.speed_error < 0.02
    matched = match(recording.passages, measure(recording, surveyed))
    found = figures(matched)
    assert found is not None
    assert matched.passages == 29
    assert found.recall == 1.0
    assert found.precision == 1.0
    assert found.median_kmh < 0.3
    assert found.in_interval > 0.9


def test_points_over_the_road_are_too_fast_until_their_height_is_known(tmp_path: Path) -> None:
    """At 0.2 m of 10 m speeds are 2 % high; the height comes out of them."""
    write_set(tmp_path, raised_m=0.2)
    recording = load_recording(*find_recordings(tmp_path)[0])
    surveyed = from_survey(recording)
    matched = match(recording.passages, measure(recording, surveyed))
    before = figures(matched)
    height_m, spread_m = point_height_m([(matched, surveyed.height_m)] * 2)
    after = figures(matched.higher(height_m / surveyed.height_m, spread_m / surveyed.height_m))
    assert before is not None
    assert after is not None
    assert before.bias_percent == pytest.approx(2.0, abs=0.4)
    assert height_m == pytest.approx(0.2, abs=0.04)
    assert abs(after.bias_percent) < 0.15


def test_positions_that_stall_at_a_border_are_left_out(tmp_path: Path) -> None:
    """Where the tracker's region ends before the last gate, points stay while vehicles drive on."""
    write_set(tmp_path)
    recording = load_recording(*find_recordings(tmp_path)[0])
    surveyed = from_survey(recording)
    border_px = float(seen(np.array([[20.0, 0.0]]))[0, 1])
    for track in recording.tracks:
        track.image_px[:, 1] = np.minimum(track.image_px[:, 1], border_px)
    kept = without_stalled_ends(counted(recording), recording, surveyed)
    assert len(kept) == len(recording.tracks)
    assert all(track.image_px[:, 1].max() < border_px for track in kept)
    found = figures(match(recording.passages, measure(recording, surveyed)))
    assert found is not None
    assert found.median_kmh < 0.5


def test_truth_is_parsed_and_never_run(tmp_path: Path) -> None:
    """What is no literal is refused in one line."""
    write_set(tmp_path)
    truth, tracks = find_recordings(tmp_path)[0]
    truth.write_bytes(gzip.compress(b"{'fps': __import__('os').getpid()}"))
    with pytest.raises(InputError, match="BrnoCompSpeed's form"):
        load_recording(truth, tracks)


def test_the_whole_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two sessions: points' height is learned on one and judged on the other."""
    for number in (1, 2):
        for side in ("left", "right"):
            write_set(tmp_path / "brno", f"session{number}_{side}", 0.15, number, 10)
    status = main(["--data", str(tmp_path), "--out", str(tmp_path / "out")])
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert abs(report["speeds"]["surveyed, points raised"]["all"]["bias_percent"]) < 0.4
    assert report["speeds"]["surveyed"]["all"]["bias_percent"] > 1.0
    assert "| session1_left |" in capsys.readouterr().out
    assert status == 1  # raised points miss the aims of the row that does not know of it


def test_without_data_it_is_skipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line says so, and nothing fails."""
    assert main(["--data", str(tmp_path)]) == 0
    assert "skipped" in capsys.readouterr().err


def test_boxes_are_scored_by_height() -> None:
    """A box half covered counts, a shifted one does not, one that nobody drew costs precision."""
    drawn = {0: np.array([[0, 0, 30, 30.0], [100, 0, 130, 30], [0, 100, 10, 110]])}
    found = {0: np.array([[0, 0, 30, 20.0], [120, 0, 150, 30], [300, 0, 360, 50]])}
    *ranges, every = score_boxes(drawn, found)
    assert (every.labelled, every.found) == (3, 3)
    assert every.recall == pytest.approx(1 / 3)
    assert every.precision == pytest.approx(1 / 3)
    assert [each.labelled for each in ranges] == [1, 0, 2, 0]
    assert ranges[1].recall is None


def test_labels_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    """Line and mend; the clip is named by its contents."""
    path = tmp_path / "x.csv"
    head = f"# {hashlib.sha256(b'clip').hexdigest()}\nframe,class,x1,y1,x2,y2\n"
    path.write_text(head + "0,car,1,2,3,4\n0,tram,1,2,3,4\n")
    with pytest.raises(InputError, match="4: unknown class tram"):
        load_labels(path)
    path.write_text(head + "7,car,1,2,3,4\n")
    assert load_labels(path).boxes[7].tolist() == [[1, 2, 3, 4]]


@pytest.mark.parametrize("path", sorted(LABELS.glob("*.csv")), ids=lambda path: path.stem)
def test_committed_labels_can_be_read(path: Path) -> None:
    """Each has frames with boxes of vehicles."""
    assert sum(len(boxes) for boxes in load_labels(path).boxes.values()) >= 200
