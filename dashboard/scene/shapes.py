"""Small bodies of the scene as triangles: vehicles, poles, depots and stops.

Each is made once, about its own origin, x ahead, z up, and drawn many times at other places and
scales. Corners of two faces are two vertices, so that viser shades each face flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Shape:
    """Triangles.

    Attributes:
        vertices: (V, 3), float32.
        faces: (F, 3), indices of vertices, anticlockwise as seen from outside.
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.uint32]


def _shape(triangles: npt.ArrayLike) -> Shape:
    vertices = np.asarray(triangles, dtype=np.float32).reshape(-1, 3)
    return Shape(vertices, np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3))


def joined(*shapes: Shape) -> Shape:
    """Several shapes as one."""
    return _shape(np.concatenate([shape.vertices for shape in shapes]))


def prism(outline: Sequence[tuple[float, float]], low: float, high: float, axis: int = 2) -> Shape:
    """A convex outline drawn out along an axis.

    Args:
        outline: corners in the plane of the two other axes, anticlockwise as seen from the axis'
            far end: (x, y) for z, (z, x) for y, (y, z) for x.
        low: lower end on the axis.
        high: upper end.
        axis: 0 for x, 1 for y, 2 for z.
    """
    flat = np.asarray(outline, dtype=np.float64)
    ends = []
    for level in (low, high):
        corners = np.empty((len(flat), 3))
        corners[:, axis], corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3] = level, *flat.T
        ends.append(corners)
    bottom, top = ends
    triangles = []
    for index in range(1, len(flat) - 1):
        triangles.append((top[0], top[index], top[index + 1]))
        triangles.append((bottom[0], bottom[index + 1], bottom[index]))
    for here in range(len(flat)):
        there = (here + 1) % len(flat)
        triangles.append((bottom[here], bottom[there], top[there]))
        triangles.append((bottom[here], top[there], top[here]))
    return _shape(triangles)


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Shape:
    """A box between two limits on each axis."""
    return prism(((x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])), *z)


def disc(radius: float, low: float, high: float, corners: int = 10) -> Shape:
    """An upright cylinder of few corners."""
    angles = 2 * np.pi * np.arange(corners) / corners
    outline = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles]
    return prism(outline, low, high)


def _side_view(outline: Sequence[tuple[float, float]], half_width: float) -> Shape:
    """An outline in (z, x) drawn out over a vehicle's width."""
    return prism(outline, -half_width, half_width, axis=1)


VAN: Final = _side_view(
    ((0.07, -0.5), (0.5, -0.5), (0.52, -0.46), (0.52, 0.2), (0.3, 0.36), (0.24, 0.5), (0.07, 0.5)),
    0.2,
)
"""A vehicle, 1 long: a van with a sloped windscreen."""
POLE: Final = joined(disc(0.09, 0.0, 1.0, 6), box((-0.14, 0.4), (-0.17, 0.17), (0.92, 1.22)))
"""A camera on a pole 1 high, which looks ahead."""
DEPOT: Final = joined(
    box((-0.5, 0.5), (-0.36, 0.36), (0.0, 0.42)),
    prism(((-0.42, 0.42), (0.42, 0.42), (0.0, 0.72)), -0.55, 0.55, axis=0),
)
"""A house 1 long with a saddle roof."""
STOP: Final = disc(0.5, 0.0, 0.5)
"""A low cylinder 1 wide."""
_ARC = 2 * np.pi * np.arange(29) / 28
_RIM = np.column_stack((np.cos(_ARC), np.sin(_ARC), np.zeros(29)))
_OUT, _NEXT = _RIM[:-1], _RIM[1:]
RING: Final = _shape(np.stack((0.8 * _OUT, _OUT, _NEXT, 0.8 * _OUT, _NEXT, 0.8 * _NEXT), axis=1))
"""A flat ring of radius 1, around what is selected."""
QUAD: Final = Shape(
    np.array([(0, -0.5, 0), (1, -0.5, 0), (1, 0.5, 0), (0, 0.5, 0)], dtype=np.float32),
    np.array([(0, 1, 2), (0, 2, 3)], dtype=np.uint32),
)
"""A strip from 0 to 1 on x, 1 wide, seen from above."""
