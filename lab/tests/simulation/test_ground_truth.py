"""Features and flag of a window in truth, and reading the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from edge_daemon.camera import WatchedSegment
from edge_daemon.settings import StabilitySettings
from slipstream.errors import InputError
from slipstream_lab.simulation.ground_truth import Truth, load_truth, true_window

FPS = 10
APPROACH = WatchedSegment(
    "approach",
    np.array([[20.0, 0.0], [80.0, 0.0], [80.0, 7.0], [20.0, 7.0]]),
    np.array([-1.0, 0.0]),
    length_m=60.0,
    lanes=2,
    lane_width_m=3.5,
)
HEADER = (
    "frame,time_s,vehicle_id,class,x_m,y_m,speed_mps,acceleration_mps2,"
    "x1_px,y1_px,x2_px,y2_px,visible_fraction,length_m,width_m\n"
)


def drive(speeds: list[float], acceleration: float = 0.0) -> Truth:
    """Vehicles 20 m apart that drive towards the camera, ten seconds."""
    rows = []
    for frame in range(100):
        now = frame / FPS
        for vehicle, speed in enumerate(speeds):
            swing = acceleration * (-1) ** (frame // 10)
            rows.append((frame, now, vehicle, 75 - 20 * vehicle - 0.01 * now, speed, swing))
    table = np.array(rows)
    n = len(table)
    return Truth(
        table[:, 0].astype(np.int64),
        table[:, 1],
        table[:, 2].astype(np.int64),
        np.column_stack([table[:, 3], np.full(n, 1.7)]),
        table[:, 4],
        table[:, 5],
        np.zeros((n, 4)),
        np.ones(n),
        np.full(n, 4.0),
        np.zeros(n, dtype=np.int64),
    )


@pytest.mark.parametrize(
    ("speeds", "swing", "y_e", "near"),
    [
        ([16.0, 16.0, 16.0], 0.0, 1, False),
        ([16.0, 10.0, 16.0], 0.0, 0, False),
        ([16.0, 16.0, 16.0], 1.0, 0, False),
        ([16.0, 16.0, 16.0], np.sqrt(0.49), 1, True),
        ([16.0, 16.0, 16.0], np.sqrt(0.53), 0, True),
        ([16.0, 10.0, 16.0], np.sqrt(0.49), 0, False),
    ],
)
def test_the_true_flag_and_its_band(
    speeds: list[float], swing: float, y_e: int, near: bool
) -> None:
    """The paper's rule; near only where the quantity that decides is within a tenth."""
    window = true_window(drive(speeds, swing), APPROACH, 0.0, 10.0, StabilitySettings())
    assert window is not None
    assert (window.y_e, window.near_threshold) == (y_e, near)
    assert window.mean_speed_mps == pytest.approx(np.mean(speeds))
    assert window.acceleration_variance_m2ps4 == pytest.approx(swing**2)
    assert window.density_veh_per_m == pytest.approx(3 / 60)
    assert window.mean_gap_m == pytest.approx(16.0)
    assert window.vehicles == 3


def test_an_empty_window_has_no_truth() -> None:
    """Nobody there, nothing to compare with."""
    nobody = drive([16.0]).take(slice(0, 0))  # type: ignore[arg-type]
    assert true_window(nobody, APPROACH, 0.0, 10.0, StabilitySettings()) is None


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a,b\n1,2\n", "no such column"),
        (HEADER + "0,0,1,car,1,2,3,4,5,6,7,8,x,4,2\n", "no number"),
        (HEADER + "0,0,1,car,1,2,3\n", "no number"),
        (HEADER + "0,0,1,car,nan,2,3,4,5,6,7,8,1,4,2\n", "not finite"),
        (b"\xff\xfe\x00".decode("latin-1"), "no such column"),
        ((HEADER + "0,0,1,car,1,2,3,4,5,6,7,8,1,4,2\n").encode("utf-16"), "not UTF-8"),
    ],
)
def test_a_bad_truth_file_is_one_line(tmp_path: Path, text: str | bytes, problem: str) -> None:
    """It names the file."""
    path = tmp_path / "truth.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError, match=problem) as caught:
        load_truth(path)
    assert "truth.csv" in str(caught.value)


def test_truth_from_another_systems_editor_is_the_same(tmp_path: Path) -> None:
    """With a byte order mark and lines that end in CRLF."""
    path = tmp_path / "truth.csv"
    text = HEADER + "0,0,1,car,1,2,3,4,5,6,7,8,1,4,2\n"
    path.write_bytes(("\ufeff" + text).replace("\n", "\r\n").encode())
    assert load_truth(path).vehicle.tolist() == [1]


def test_a_missing_truth_file_is_one_line(tmp_path: Path) -> None:
    """Not a traceback."""
    with pytest.raises(InputError, match="no such file"):
        load_truth(tmp_path / "none.csv")


def test_the_truth_is_told_for_any_time_of_a_clip() -> None:
    """A clip of the same traffic may have other frames: those between are interpolated."""
    truth = drive([16.0, 10.0])
    own, between, rounded = truth.at(np.array([2.0, 2.05, 2.0004]))
    assert list(own.vehicle) == [0, 1]
    assert own.centre_m[0, 0] == pytest.approx(75 - 0.02)
    assert between.centre_m[0, 0] == pytest.approx(75 - 0.0205)
    assert between.time_s == pytest.approx(2.05)
    assert (rounded.centre_m == own.centre_m).all()


def test_where_the_truth_has_no_frame_nobody_is() -> None:
    """Before and after it, in a stretch without a vehicle; one that comes later is not there."""
    truth = drive([16.0, 10.0])
    truth = truth.take((truth.time_s < 2.0) | (truth.time_s > 4.0))
    late = (truth.vehicle == 1) & (truth.time_s < 5.0)
    truth = truth.take(~late)
    found = truth.at(np.array([-1.0, 1.0, 3.0, 4.96, 20.0]))
    assert [list(vehicles.vehicle) for vehicles in found] == [[], [0], [], [0], []]
    assert [len(vehicles) for vehicles in truth.take(np.arange(0)).at(np.array([1.0]))] == [0]
