"""Where a camera hangs, and where in its box a vehicle stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_daemon.camera import Camera
from edge_daemon.camera.homography import Homography
from edge_daemon.camera.pose import pose_of
from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.painter import PlacedMesh
from slipstream_lab.simulation.streetdrive.vehicles.catalogue import build_vehicle

from ..conftest import FOCAL_PX, POLE_M

ROAD = np.array([[20.0, -8.0], [20.0, 8.0], [45.0, -8.0], [45.0, 8.0], [80.0, -8.0], [80.0, 8.0]])


@given(
    height=st.floats(4, 30),
    lateral=st.floats(-15, 15),
    pitch=st.floats(0.1, 0.5),
    yaw=st.floats(-0.5, 0.5),
    focal=st.floats(500, 3000),
    roll=st.floats(-0.1, 0.1),
    turn=st.floats(0, 6.3),
    east=st.floats(-1e5, 1e5),
)
@settings(max_examples=60)
def test_the_pose_is_that_of_the_camera_that_made_the_picture(
    height: float,
    lateral: float,
    pitch: float,
    yaw: float,
    focal: float,
    roll: float,
    turn: float,
    east: float,
) -> None:
    """Foot, height and focal length come back however the road's coordinates are turned."""
    camera = PinholeCamera(height, lateral, pitch, yaw, focal, roll)
    pixels, _ = camera.project(np.column_stack([ROAD, np.zeros(len(ROAD))]))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    pose = pose_of(Homography(ROAD @ rotation.T + (east, 0), pixels), (1280, 720))
    assert pose is not None
    assert pose.focal_px == pytest.approx(focal, rel=1e-3)
    assert pose.height_m == pytest.approx(height, rel=1e-3)
    foot = rotation @ [0.0, lateral] + (east, 0)
    assert pose.foot_m == pytest.approx(foot, abs=0.02)
    above = np.array([[30.0, 2.0, 1.5], [60.0, -3.0, 4.0]])
    turned = np.column_stack([above[:, :2] @ rotation.T + (east, 0), above[:, 2]])
    assert pose.project(turned) == pytest.approx(camera.project(above)[0], abs=0.1)


def test_the_camera_knows_its_pose(camera: Camera) -> None:
    """Loaded from a file, it hangs where it was put, and looks from there."""
    assert camera.pose is not None
    assert camera.pose.height_m == pytest.approx(POLE_M, abs=0.01)
    assert camera.pose.focal_px == pytest.approx(FOCAL_PX, rel=1e-3)
    assert camera.pose.foot_m == pytest.approx((0, 0), abs=0.01)


def test_a_view_that_no_plain_camera_has_gives_no_pose() -> None:
    """A road drawn out along itself by a mistake in the distances has no pose."""
    camera = PinholeCamera(10.0, 8.0, 0.3, -0.2, 1000.0)
    pixels, _ = camera.project(np.column_stack([ROAD, np.zeros(len(ROAD))]))
    assert pose_of(Homography(ROAD * (1.0, 50.0), pixels), (1280, 720)) is None


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "off_m"), [("saloon", 0.35), ("suv", 0.35), ("truck", 0.6)])
def test_a_vehicles_middle_is_told_from_its_box(camera: Camera, shape: str, off_m: float) -> None:
    """From the boxes of drawn vehicles, turned any way, it is met to a few decimetres."""
    assert camera.pose is not None
    rng = np.random.default_rng(3)
    for _ in range(20):
        mesh = build_vehicle(shape, rng)
        turn, middle = rng.uniform(0, 2 * np.pi), rng.uniform((25, -8), (75, 8))
        placed = PlacedMesh(mesh, float(middle[0]), float(middle[1]), 1, turn)
        pixels = camera.pose.project(placed.to_world(mesh.corners.reshape(-1, 3)))
        (left, _), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
        point = camera.to_road([[(left + right) / 2, bottom]])
        offset = camera.pose.centre_offset(
            point,
            np.array([[np.cos(turn), np.sin(turn)]]),
            np.array([[mesh.length_m, mesh.width_m, mesh.height_m]]),
        )
        assert np.hypot(*(point + offset - middle)[0]) < off_m
        assert np.hypot(*(point - middle)[0]) > off_m


def test_a_vehicle_out_of_view_has_no_middle(camera: Camera) -> None:
    """Behind the camera the answer is NaN, not a wrong number."""
    assert camera.pose is not None
    points = np.array([[-20.0, 0.0], [40.0, 0.0]])
    offset = camera.pose.centre_offset(
        points, np.array([[-1.0, 0.0]] * 2), np.array([[4.5, 1.8, 1.5]] * 2)
    )
    assert np.isnan(offset[0]).all()
    assert np.isfinite(offset[1]).all()
