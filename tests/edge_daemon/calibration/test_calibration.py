"""Calibrating from points: mistakes found, accuracy stated, files that load."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_daemon.calibration.advice import overlap_m2
from edge_daemon.calibration.calibration import Calibration, calibrate, stated_calibration
from edge_daemon.calibration.files import (
    camera_toml,
    read_picture,
    read_points,
    reference_of,
    write_picture,
)
from edge_daemon.calibration.overlay import draw_grid
from edge_daemon.camera import WatchedSegment, load_camera
from edge_daemon.camera.homography import Homography
from edge_daemon.settings import CalibrationPoint, SegmentSettings
from slipstream.errors import InputError

from ..conftest import POLE_M, project

SIZE = (1280, 720)
FAR_M = 3000.0
SOURCE = Path("points.toml")
ROAD = np.array([(x, y) for x in (18, 30, 45, 65, 90) for y in (-8, 8)], dtype=np.float64)
SEGMENT = SegmentSettings(
    id="approach", polygon=((20, 0), (80, 0), (80, 7), (20, 7)), direction=(-1, 0), lanes=2
)


def points_of(
    image: npt.NDArray[np.float64], road: npt.NDArray[np.float64] = ROAD
) -> tuple[CalibrationPoint, ...]:
    """Points as a file gives them."""
    return tuple(
        CalibrationPoint(image=(float(u), float(v)), road=(float(x), float(y)))
        for (u, v), (x, y) in zip(image, road, strict=True)
    )


def calibrated(noise_px: float = 0.0, seed: int = 0) -> Calibration:
    """The camera calibrated from clicks so far off."""
    rng = np.random.default_rng(seed)
    image = project(ROAD) + rng.normal(0, noise_px, ROAD.shape)
    return calibrate(points_of(image), (SEGMENT,), SIZE, SOURCE)


def test_exact_points_give_the_camera_back() -> None:
    """No miss, no warning, and the pose that took the picture."""
    result = calibrated()
    assert result.reprojection_error_px < 1e-6
    assert result.warnings == ()
    assert result.used.all()
    assert result.pose is not None
    assert result.pose.height_m == pytest.approx(POLE_M, abs=1e-3)


@pytest.mark.slow
@given(wrong=st.integers(0, len(ROAD) - 1), east=st.floats(25, 200), seed=st.integers(0, 99))
@settings(max_examples=8, deadline=None)
def test_one_mistake_among_ten_is_named_and_left_out(wrong: int, east: float, seed: int) -> None:
    """Whichever point has a wrong road coordinate, it alone is left out of the fit."""
    image = project(ROAD) + np.random.default_rng(seed).normal(0, 0.7, ROAD.shape)
    road = ROAD.copy()
    road[wrong] += (0, east)
    result = calibrate(points_of(image, road), (SEGMENT,), SIZE, SOURCE)
    assert np.flatnonzero(~result.used).tolist() == [wrong]
    assert any(f"point {wrong + 1} " in warning for warning in result.warnings)
    assert result.reprojection_error_px < 3


@pytest.mark.slow
def test_the_stated_accuracy_is_what_repeated_clicking_shows() -> None:
    """Spread of positions and of speeds over 300 calibrations with 1 px clicks, at both ends."""
    stated = {end.end: end for end in calibrated().accuracy}
    near_far = np.array([stated["near"].point_m, stated["far"].point_m])
    true = Homography(ROAD, project(ROAD))
    pixels = true.to_image(near_far)
    later = true.to_image(near_far - np.array([0.1, 0.0]))
    rng = np.random.default_rng(5)
    positions, speeds = [], []
    for _ in range(300):
        fit = Homography(ROAD, project(ROAD) + rng.normal(0, 1, ROAD.shape))
        positions.append(fit.to_road(pixels)[:, 0])
        speeds.append((fit.to_road(pixels) - fit.to_road(later))[:, 0] / 0.1)
    for i, end in enumerate(("near", "far")):
        assert stated[end].position_error_m == pytest.approx(np.std(positions, axis=0)[i], rel=0.15)
        assert stated[end].speed_error == pytest.approx(np.std(speeds, axis=0)[i], rel=0.15)


@pytest.mark.long
def test_clicks_that_are_worse_than_a_pixel_are_told_from_the_misses() -> None:
    """The error of the clicks comes from the misses where these show more than 1 px."""
    told = [calibrated(2.0, seed).click_px for seed in range(8)]
    assert np.mean(told) == pytest.approx(2.0, rel=0.25)
    assert calibrated(0.1).click_px == 1.0


def test_what_a_person_should_look_at_is_said() -> None:
    """Four near points, a wrong lane count, an overlap and an unlikely height each warn."""
    four = np.array([(20, -2), (20, 2), (26, -2), (26, 2)], dtype=np.float64)
    narrow = SEGMENT.model_copy(update={"lanes": 1, "id": "narrow"})
    result = calibrate(points_of(project(four), four), (SEGMENT, narrow), SIZE, SOURCE)
    said = "\n".join(result.warnings)
    assert "four points fit any calibration" in said
    assert "segment narrow: its outline is 7.0 m wide, its lanes 3.5 m" in said
    assert "segments approach and narrow overlap by 420 m²" in said
    assert "segment approach: speeds at its far end are unsure by" in said
    tenfold = calibrate(points_of(project(ROAD), 20 * ROAD), (), SIZE, SOURCE)
    assert any("180.0 m above the road" in warning for warning in tenfold.warnings)
    stretched = calibrate(points_of(project(ROAD), ROAD * (1, 30)), (), SIZE, SOURCE)
    assert any("no plain camera" in warning for warning in stretched.warnings)


def test_an_end_that_a_click_puts_beyond_the_horizon_is_warned_of() -> None:
    """Its errors are infinite, not missing, and JSON has null for them."""
    four = np.array([(20, -2), (20, 2), (26, -2), (26, 2)], dtype=np.float64)
    long = SEGMENT.model_copy(update={"polygon": ((20, 0), (FAR_M, 0), (FAR_M, 7), (20, 7))})
    result = calibrate(points_of(project(four), four), (long,), SIZE, SOURCE)
    assert result.accuracy[1].speed_error == np.inf
    assert result.accuracy[1].as_json()["speed_error"] is None
    assert any("far end cannot be measured with clicks" in said for said in result.warnings)


@pytest.mark.slow
@given(shift=st.floats(-12, 12))
def test_shared_area_is_that_of_the_shared_rectangle(shift: float) -> None:
    """Two rectangles of 10 m by 4 m, one moved along."""
    outline = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 4.0], [0.0, 4.0]])
    one, other = (
        WatchedSegment("s", outline + np.array([by, 0.0]), np.array([1.0, 0.0]), 10.0, 1, 4.0)
        for by in (0.0, shift)
    )
    assert overlap_m2(one, other) == pytest.approx(4 * max(0.0, 10 - abs(shift)), abs=0.5)


def test_the_written_file_loads_as_it_was_fitted(tmp_path: Path) -> None:
    """Names with quotes, points, segments and the reference survive; outliers stay out."""
    image = project(ROAD)
    image[3] += (0, 60)
    odd = SEGMENT.model_copy(update={"id": 'north "A"\\1'})
    result = calibrate(points_of(image), (odd,), SIZE, SOURCE)
    view = tmp_path / "view.png"
    write_picture(view, np.zeros((720, 1280, 3), dtype=np.uint8))
    out = tmp_path / "cameras" / "north.toml"
    out.parent.mkdir()
    out.write_text(camera_toml('mast "7"', result, (odd,), reference_of(view, out)))
    camera = load_camera(out)
    assert camera.name == 'mast "7"'
    assert camera.segments[0].id == odd.id
    assert camera.segments[0].lanes == 2
    assert camera.reprojection_error_px < 1e-6
    assert camera.reference is not None
    assert camera.reference.samefile(view)
    assert camera.to_road([[600.0, 500.0]]) == pytest.approx(
        result.projection.to_road([[600.0, 500.0]]), abs=1e-9
    )


def test_a_file_states_what_its_calibration_did(tmp_path: Path) -> None:
    """The worst end of its segment, its misses, and when it was written; not where none can be."""
    result = calibrated(noise_px=2.0)
    out = tmp_path / "camera.toml"
    write_picture(tmp_path / "view.png", np.zeros((720, 1280, 3), dtype=np.uint8))
    out.write_text(camera_toml("mast", result, (SEGMENT,), "view.png"))
    os.utime(out, ns=(5, 7_000_000_000))
    told = stated_calibration(out, load_camera(out))
    assert (told.file, told.written_ns, told.points) == (str(out), 7_000_000_000, 10)
    assert told.residual_px == pytest.approx(result.reprojection_error_px)
    assert told.speed_error == pytest.approx(max(end.speed_error for end in result.accuracy))
    assert told.speed_error > 0.001


def test_points_come_from_csv_too(tmp_path: Path) -> None:
    """Columns in any order, from any system's editor; a bad line is named."""
    path = tmp_path / "points.CSV"
    text = "x,y,u,v\n1,2,3,4\n5,6,7,8\n9,10,11,12\n13,14,15,16\n"
    for written in (text, "\ufeff" + text.replace("\n", "\r\n")):
        path.write_bytes(written.encode())
        assert read_points(path).points[1] == CalibrationPoint(image=(7, 8), road=(5, 6))
    path.write_bytes(text.encode("utf-16"))
    with pytest.raises(InputError, match=r"points\.CSV: not text: encoded in UTF-16"):
        read_points(path)
    path.write_text("x,y,u,v\n1,2,3,4\n5,6,7\n")
    with pytest.raises(InputError, match="line 3: not four numbers"):
        read_points(path)


def test_the_first_frame_of_a_video_is_its_picture(tmp_path: Path) -> None:
    """A picture is read as it is, a video by its first frame, anything else refused."""
    clip = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for shade in (200, 20, 20):
        writer.write(np.full((48, 64, 3), shade, dtype=np.uint8))
    writer.release()
    picture, is_video = read_picture(clip)
    assert is_video
    assert picture.mean() == pytest.approx(200, abs=5)
    write_picture(tmp_path / "p.png", picture)
    again, is_video = read_picture(tmp_path / "p.png")
    assert not is_video
    assert np.array_equal(again, picture)
    clip.write_bytes(b"no video at all")
    with pytest.raises(InputError, match="neither a picture nor a readable video"):
        read_picture(clip)


def test_the_grid_is_drawn_where_the_road_is() -> None:
    """Along x = 50 m and round the segment the picture changes; far beside the road it does not."""
    picture = np.full((720, 1280, 3), 90, dtype=np.uint8)
    drawn = draw_grid(picture, calibrated())
    assert (picture == 90).all()
    for x, y in ((50.0, -3.3), (50.0, 5.5), (33.0, 7.0)):
        u, v = project([[x, y]])[0].round().astype(int)
        assert (drawn[v - 1 : v + 2, u - 1 : u + 2] != 90).any()
    assert (drawn[:60] == 90).all()


def test_small_pictures_are_enlarged_for_the_grid() -> None:
    """A picture of 640 px is drawn at 1280, so that labels can be read."""
    image = project(ROAD) / 2
    result = calibrate(points_of(image), (SEGMENT,), (640, 360), SOURCE)
    assert draw_grid(np.zeros((360, 640, 3), dtype=np.uint8), result).shape == (720, 1280, 3)
