"""Bodies are closed, face outwards and are as large as they say."""

from __future__ import annotations

import numpy as np
import pytest

from dashboard.scene import shapes
from dashboard.scene.shapes import Shape

SOLID = ("VAN", "POLE", "DEPOT", "STOP")


def _triangles(shape: Shape) -> np.ndarray:
    return shape.vertices.astype(np.float64)[shape.faces]


@pytest.mark.parametrize("name", SOLID)
def test_a_body_is_closed(name):
    """Each edge of a triangle is the edge of another one, in the other direction."""
    corners = np.round(_triangles(getattr(shapes, name)), 5)
    edges: dict[tuple[object, object], int] = {}
    for triangle in corners.tolist():
        points = [tuple(point) for point in triangle]
        for start, end in zip(points, points[1:] + points[:1], strict=True):
            edges[start, end] = edges.get((start, end), 0) + 1
    assert all(edges.get((end, start), 0) == count for (start, end), count in edges.items())


@pytest.mark.parametrize("name", SOLID)
def test_faces_are_seen_from_outside(name):
    """The volume by the triangles' directions is positive, and not above that of the box around."""
    a, b, c = np.moveaxis(_triangles(getattr(shapes, name)), 1, 0)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    around = np.ptp(getattr(shapes, name).vertices, axis=0)
    assert 0 < volume <= np.prod(around)


@pytest.mark.parametrize("name", ["QUAD", "RING"])
def test_flat_shapes_look_up(name):
    """Flat shapes are seen from above."""
    a, b, c = np.moveaxis(_triangles(getattr(shapes, name)), 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_vehicles_are_one_long_and_look_ahead():
    """A vehicle is 1 long along x and lower in front."""
    vertices = shapes.VAN.vertices
    np.testing.assert_allclose((vertices[:, 0].min(), vertices[:, 0].max()), (-0.5, 0.5))
    rear, front = (vertices[vertices[:, 0] == x][:, 2].max() for x in (-0.5, 0.5))
    assert rear > front
