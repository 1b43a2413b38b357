"""Lines are offset to the right, cut without loss, and measured along their length."""

from __future__ import annotations

import numpy as np
import pytest

from dashboard.scene import geometry
from slipstream.roads.sumo_net import load_network

BENT = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]])


def test_offset_is_to_the_right():
    """An eastbound line moves south, a corner to the left is mitred outwards."""
    moved = geometry.offset(BENT, 10.0)
    np.testing.assert_allclose(moved, [[0, -10], [110, -10], [110, 50]], atol=1e-9)


def test_a_sharp_corner_has_no_spike():
    """Where a line all but turns back on itself its corner is cut, at 1.5 times the offset."""
    sharp = np.array([[0.0, 0.0], [100.0, 0.0], [0.0, 10.0]])
    away = np.linalg.norm(geometry.offset(sharp, 10.0) - sharp, axis=1)
    np.testing.assert_allclose(away, [10.0, 15.0, 10.0])


def test_two_directions_part():
    """The two directions of a road lie on opposite sides of it."""
    there = geometry.offset(BENT[:2], 10.0)
    back = geometry.offset(BENT[1::-1], 10.0)
    assert there[0, 1] == -10.0
    assert back[0, 1] == 10.0


def test_offset_survives_u_turns_and_repeats():
    """A line that turns back on itself, or repeats a point, stays finite."""
    u_turn = geometry.drop_repeated_points([(0.0, 0.0), (50.0, 0.0), (50.0, 0.0), (0.0, 0.0)])
    assert np.isfinite(geometry.offset(u_turn, 10.0)).all()
    assert len(geometry.drop_repeated_points([(1.0, 1.0), (1.0, 1.0)])) == 2


def test_dashes_cover_the_line():
    """Dashes follow each other without gaps, are of one length, and go round corners."""
    cut, dash = geometry.dash_strokes(BENT, 12.0)
    lengths = np.linalg.norm(cut[:, 1] - cut[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(150.0)
    np.testing.assert_allclose(cut[1:, 0], cut[:-1, 1])
    per_dash = np.bincount(dash, weights=lengths)
    np.testing.assert_allclose(per_dash, 150.0 / round(150 / 12))
    assert any(np.allclose(end, (100.0, 0.0)) for end in cut[:, 1])


def test_places_along_a_line():
    """A share of a line's length is found on it, with the direction there."""
    place, ahead = geometry.point_at(BENT, 0.8)
    np.testing.assert_allclose(place, (100.0, 20.0))
    np.testing.assert_allclose(ahead, (0.0, 1.0))
    np.testing.assert_allclose(geometry.point_at(BENT, -1.0)[0], (0.0, 0.0))
    np.testing.assert_allclose(geometry.point_at(BENT, 2.0)[0], (100.0, 50.0))


def test_arrowheads_point_ahead():
    """Both strokes of an arrowhead end in its tip, half its size ahead of its place."""
    places, ahead = np.array([[10.0, 0.0], [0.0, 20.0]]), np.array([[1.0, 0.0], [0.0, -1.0]])
    heads = geometry.arrowheads(places, ahead, 6.0)
    np.testing.assert_allclose(heads[:2, 1], [[13.0, 0.0]] * 2)
    np.testing.assert_allclose(heads[2:, 1], [[0.0, 17.0]] * 2)
    np.testing.assert_allclose(heads[:2, 0], [[7.0, -4.2], [7.0, 4.2]])


def test_every_road_of_the_demo_can_be_drawn():
    """All segments of the demo network give finite lines and dashes."""
    for segment in load_network("demo").segments.values():
        line = geometry.offset(geometry.drop_repeated_points(segment.shape), 20.0)
        cut, _ = geometry.dash_strokes(line, 15.0)
        assert np.isfinite(cut).all()


def _area(corners, faces) -> float:
    a, b, c = np.moveaxis(corners[faces], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (twice > 0).all()
    return float(twice.sum() / 2)


def test_a_ribbon_is_as_wide_as_it_is_said_to_be():
    """A line's band has its length times its width, all of it seen from above."""
    corners, faces = geometry.ribbon(BENT, 10.0)
    assert _area(corners, faces) == pytest.approx(150.0 * 10.0)
    cut = geometry.strokes(BENT)
    assert _area(*geometry.bands(cut, np.array([10.0, 4.0]))) == pytest.approx(1000.0 + 200.0)


def test_the_nearest_stroke_is_found():
    """A place belongs to the stroke it is nearest to, beyond its ends too."""
    cut = geometry.strokes(BENT)
    assert geometry.nearest_stroke(cut, np.array([50.0, 3.0])) == (0, pytest.approx(3.0))
    assert geometry.nearest_stroke(cut, np.array([104.0, 53.0])) == (1, pytest.approx(5.0))
