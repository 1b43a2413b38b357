"""Calibration and watched segments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_daemon.camera import Camera, load_camera
from slipstream.errors import InputError

from .conftest import camera_toml, project


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


SECOND_APPROACH = """
[[segments]]
id = "approach"
polygon = [[20.0, -7.0], [80.0, -7.0], [80.0, 0.0]]
direction = [1.0, 0.0]
"""
LINE = [(20.0, 2.0), (40.0, 2.0), (60.0, 2.0), (80.0, 2.0)]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (camera_toml(LINE), "one line"),
        (camera_toml([(20.0, 2.0)] * 4), "points 1 and 2 share one place"),
        (camera_toml([(20, -8), (20, 8), (80, -8)]), "points"),
        (camera_toml(extra="colour = 'red'\n"), "unknown key"),
        (camera_toml().replace("schema = 1", "schema = 9"), "schema"),
        (camera_toml().replace("width = 1280", "width = 0"), "image.width"),
        (camera_toml().replace("[-1.0, 0.0]", "[0.0, 0.0]"), "direction"),
        (camera_toml().replace("road = [45, 8]", "road = [70, 8]"), "misses its own points"),
        (camera_toml().replace("20.0, 0.0", "inf, 0.0"), "polygon"),
        (camera_toml(extra=SECOND_APPROACH), "two segments with one id"),
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
