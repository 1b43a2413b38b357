"""Projection and its inverse agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera

CAMERA = PinholeCamera(10.0, 8.0, math.radians(16), math.radians(-9), 1000.0, math.radians(1))


@given(st.floats(8, 300), st.floats(-30, 30))
def test_ground_points_survive_the_round_trip(x, y):
    """Projecting a road point and going back gives the point."""
    pixels, depth = CAMERA.project(np.array([x, y, 0.0]))
    assert depth > 0
    back, hits = CAMERA.to_ground(pixels)
    assert hits
    assert back == pytest.approx([x, y], abs=1e-6 * x * x)


@given(st.floats(8, 300), st.floats(-30, 30))
def test_homography_is_the_projection_of_the_road_plane(x, y):
    """The ground homography and the projection give the same pixel."""
    u, v, w = CAMERA.ground_homography @ [x, y, 1.0]
    pixels, _ = CAMERA.project(np.array([x, y, 0.0]))
    assert pixels == pytest.approx([u / w, v / w])


def test_axes_point_where_they_should():
    """Farther is higher in the picture, left on the road is left, and up is up."""
    near, far, left, above = CAMERA.project(
        np.array([[30.0, 0, 0], [60.0, 0, 0], [30.0, 3, 0], [30.0, 0, 2]])
    )[0]
    assert far[1] < near[1]
    assert left[0] < near[0]
    assert above[1] < near[1]


def test_sky_has_no_ground():
    """A ray above the horizon hits no road."""
    _, hits = CAMERA.to_ground(np.array([[640.0, 5.0], [640.0, 700.0]]))
    assert hits.tolist() == [False, True]


@pytest.mark.parametrize("change", [{"height_m": 0.0}, {"focal_px": -1.0}, {"pitch_rad": 2.0}])
def test_impossible_cameras_are_refused(change):
    """Heights, focal lengths and pitches without meaning raise ValueError."""
    values = {
        "height_m": 9.0,
        "lateral_m": 0.0,
        "pitch_rad": 0.3,
        "yaw_rad": 0.0,
        "focal_px": 900.0,
    }
    with pytest.raises(ValueError, match=r"positive|pitch"):
        PinholeCamera(**{**values, **change})
