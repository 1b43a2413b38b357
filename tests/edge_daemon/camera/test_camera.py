"""Calibration and watched segments."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_daemon.camera import Camera, WatchedSegment, load_camera
from slipstream.errors import InputError

from ..conftest import camera_toml, project


@given(x=st.floats(12.0, 150.0), y=st.floats(-15.0, 15.0))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_road_maps_to_the_picture_and_back(camera: Camera, x: float, y: float) -> None:
    """The homography agrees with the pinhole camera, and inverts itself."""
    pixel = camera.to_image([[x, y]])
    assert pixel == pytest.approx(project([[x, y]]), abs=1e-3)
    assert camera.to_road(pixel)[0] == pytest.approx((x, y), abs=1e-4)


def test_map_coordinates_of_a_million_metres_work_as_well(tmp_path: Path) -> None:
    """The road's origin may be anywhere, as in UTM coordinates."""
    east, north = 608_000.0, 4_731_000.0
    lines = []
    for line in camera_toml().splitlines():
        if line.startswith("road = "):
            x, y = (float(v) for v in line[8:-1].split(","))
            line = f"road = [{x + east}, {y + north}]"
        elif line.startswith("polygon = "):
            outline = [(20.0, 0.0), (80.0, 0.0), (80.0, 7.0), (20.0, 7.0)]
            line = f"polygon = {[[x + east, y + north] for x, y in outline]}"
        lines.append(line)
    path = tmp_path / "utm.toml"
    path.write_text("\n".join(lines))
    camera = load_camera(path)
    pixel = project([[50.0, 3.0]])
    assert camera.to_road(pixel)[0] - (east, north) == pytest.approx((50.0, 3.0), abs=1e-3)
    (segment,) = camera.segments
    points = np.array([[east + 50.0, north + 0.05], [east + 50.0, north - 0.05]])
    assert segment.contains(points).tolist() == [True, False]


def test_the_sky_is_no_road(camera: Camera) -> None:
    """Pixels above the horizon have no road point."""
    assert np.isnan(camera.to_road([[640.0, 5.0]])).all()
    assert np.isfinite(camera.to_road([[640.0, 700.0]])).all()


def test_the_jacobian_is_the_derivative(camera: Camera) -> None:
    """It agrees with central differences, near and far."""
    pixels = camera.to_image([[20.0, 3.0], [90.0, -4.0]])
    jacobian = camera.jacobian(pixels)
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = 1e-3
        difference = (camera.to_road(pixels + step) - camera.to_road(pixels - step)) / 2e-3
        assert jacobian[:, :, axis] == pytest.approx(difference, rel=1e-4, abs=1e-7)


def test_segments_know_their_length_lanes_and_inside(camera: Camera) -> None:
    """Positions run in the direction of travel; lanes count from the right."""
    segment = camera.segments[0]
    assert segment.length_m == pytest.approx(60.0)
    points = np.array([[50.0, 1.0], [50.0, 6.0], [50.0, -1.0], [90.0, 1.0]])
    assert segment.contains(points).tolist() == [True, True, False, False]
    # Driving towards −x, the right edge is at y = 7.
    assert segment.lane(points[:2]).tolist() == [1, 0]
    assert segment.along(points)[0] == pytest.approx(-50.0)


@pytest.mark.slow
@given(
    corners=st.lists(
        st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=3, max_size=8, unique=True
    ),
    points=st.lists(st.tuples(st.floats(-60, 60), st.floats(-60, 60)), min_size=1, max_size=20),
)
def test_inside_is_what_opencv_calls_inside(
    corners: list[tuple[float, float]], points: list[tuple[float, float]]
) -> None:
    """Away from the outline, the vectorised test agrees with OpenCV's, crossing or not."""
    polygon = np.array(corners)
    segment = WatchedSegment("s", polygon, np.array([1.0, 0.0]), 1.0, 1, 3.5)
    contour = polygon.astype(np.float32).reshape(-1, 1, 2)
    for point, inside in zip(points, segment.contains(np.array(points)), strict=True):
        distance = cv2.pointPolygonTest(contour, point, True)
        if abs(distance) > 1e-3:
            assert inside == (distance > 0)


def test_a_point_between_two_segments_lies_in_one(camera: Camera) -> None:
    """Neighbours that share an edge share no point of it; NaN lies nowhere."""
    direction = np.array([1.0, 0.0])
    lower = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 4.0], [0.0, 4.0]])
    segments = [
        WatchedSegment("s", lower + np.array([0, shift]), direction, 10.0, 1, 4.0)
        for shift in (0.0, 4.0)
    ]
    points = np.array([[x, 4.0] for x in (0.5, 5.0, 9.5)])
    assert sum(s.contains(points).astype(int) for s in segments).tolist() == [1, 1, 1]
    assert not camera.segments[0].contains(np.full((2, 2), np.nan)).any()


SECOND_APPROACH = """
[[segments]]
id = "approach"
polygon = [[20.0, -7.0], [80.0, -7.0], [80.0, 0.0]]
direction = [1.0, 0.0]
"""
FOUR = [(20.0, -8.0), (20.0, 8.0), (80.0, -8.0), (80.0, 8.0)]


def swapped(i: int, j: int, what: str, points: list[tuple[float, float]] | None = None) -> str:
    """The calibration with two points' road coordinates exchanged."""
    lines = camera_toml(points).splitlines()
    at = [n for n, line in enumerate(lines) if line.startswith(f"{what} = ")]
    lines[at[i]], lines[at[j]] = lines[at[j]], lines[at[i]]
    return "\n".join(lines)


def mirrored() -> str:
    """The calibration with y to the right."""
    lines = camera_toml().splitlines()
    for n, line in enumerate(lines):
        if line.startswith("road = "):
            x, y = line[8:-1].split(", ")
            lines[n] = f"road = [{x}, {-float(y)}]"
    return "\n".join(lines)


def outline(corners: str) -> str:
    """The calibration with another outline of its segment."""
    lines = camera_toml().splitlines()
    return "\n".join(
        f"polygon = [{corners}]" if line.startswith("polygon") else line for line in lines
    )


def masked(corners: str) -> str:
    """The calibration with something that must not be looked at."""
    return camera_toml().replace("[image]", f"masks = [[{corners}]]\n[image]")


EIGHT = [(20, -8), (20, 8), (45, -8), (45, 8), (80, -8), (80, 8), (30, 0), (60, 3)]
LINE = [(20.0, 2.0), (40.0, 2.0), (60.0, 2.0), (80.0, 2.0)]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (camera_toml(EIGHT).replace("[45, 8]", "[75, 8]"), r"by .* px .point 4 misses by \d+ px"),
        (camera_toml(LINE), "one line"),
        (camera_toml([(20.0, 2.0)] * 4), "points 1 and 2 share one place"),
        (camera_toml([(20, -8), (20, 8), (80, -8)]), "points"),
        (camera_toml(extra="colour = 'red'\n"), "unknown key"),
        (camera_toml().replace("schema = 1", "schema = 9"), "schema"),
        (camera_toml().replace("width = 1280", "width = 0"), "image.width"),
        (camera_toml().replace("[-1.0, 0.0]", "[0.0, 0.0]"), "direction"),
        (
            camera_toml().replace("road = [45, 8]", "road = [70, 8]"),
            "misses its own points .* .1 of the points 2, 4, 6 must be wrong",
        ),
        (camera_toml().replace("20.0, 0.0", "inf, 0.0"), "polygon"),
        (camera_toml(extra=SECOND_APPROACH), "two segments with one id"),
        (swapped(0, 1, "road"), "inside out"),
        (swapped(0, 1, "road", FOUR), "inside out"),
        (camera_toml([(20, -8), (20, 8), (80, 8), (45, 8)]), "too many of the points"),
        (mirrored(), "mirrored"),
        (camera_toml([(20, -8), (20, 8), (10, 8), (80, 8)]), "outside the 1280×720 picture"),
        (camera_toml().replace("[20, -8]", "[nan, -8]"), "points.0.road"),
        (camera_toml().replace("[20, -8]", "[1e300, -8]"), "points.0.road"),
        (outline("[20, 0], [80, 7], [80, 0], [20, 7]"), "approach: polygon crosses itself"),
        (outline("[20, 0], [50, 0], [80, 0]"), "approach: polygon has no area"),
        (outline("[-5, 0], [80, 0], [80, 7], [-5, 7]"), "behind the horizon"),
        (outline("[200, 200], [300, 200], [300, 207]"), "outside the picture"),
        (outline("[2, 0], [25, 0], [25, 7], [2, 7]"), "of the polygon lies in the picture"),
        (camera_toml().replace("[-1.0, 0.0]", "[0.0, 1.0]"), "across its direction"),
        (camera_toml().replace("[image]", "reference = 'none.png'\n[image]"), "no such picture"),
        (masked("[0, 0], [99, 0], [99, 721]"), r"\(99, 721\) lies outside the 1280×720 picture"),
        (masked("[0, 0], [99, 0]"), "masks.0"),
        (masked("[600, 400], [700, 400], [650, 500]"), "masks.0: covers watched road"),
    ],
)
def test_unusable_calibrations_are_one_line(tmp_path: Path, text: str, problem: str) -> None:
    """Each fault names the file and what is wrong."""
    path = tmp_path / "camera.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=problem) as caught:
        load_camera(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_outline_may_be_closed_and_a_reference_named(tmp_path: Path) -> None:
    """A repeated first corner is dropped; the reference is found beside the file."""
    (tmp_path / "view.png").write_bytes(b"")
    path = tmp_path / "camera.toml"
    closed = outline("[20, 0], [80, 0], [80, 7], [20, 7], [20, 0]")
    path.write_text(closed.replace("[image]", "reference = 'view.png'\n[image]"))
    camera = load_camera(path)
    assert len(camera.segments[0].polygon_m) == 4
    assert camera.reference == tmp_path / "view.png"


def test_road_and_derivative_come_in_one_go(camera: Camera) -> None:
    """They are those that come one by one, NaN above the horizon."""
    pixels = np.array([[640.0, 500.0], [300.0, 400.0], [640.0, 5.0]])
    road, jacobian = camera.to_road_with_jacobian(pixels)
    assert np.array_equal(road, camera.to_road(pixels), equal_nan=True)
    assert np.array_equal(jacobian, camera.jacobian(pixels), equal_nan=True)
    assert np.isnan(road[2]).all()
    assert np.isnan(jacobian[2]).all()
