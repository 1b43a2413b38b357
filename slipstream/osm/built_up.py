"""Which roads of an OpenStreetMap extract lie inside of built-up areas."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from slipstream.osm.survey import DEGREE_M, Survey, Way

Floats = npt.NDArray[np.float64]

_NEAR_M: Final = 200.0
"""From a residential street: in a town no through road is further away for long."""
_STEP_M: Final = 25.0
_RESIDENTIAL: Final = frozenset({"residential", "living_street"})


class BuiltUp:
    """Tells by built-up areas of the map, and by residential streets nearby."""

    def __init__(self, survey: Survey) -> None:
        self._places = survey.places
        first = next(iter(survey.places.values()), (0.0, 0.0))
        self._origin = first
        self._scale = DEGREE_M * math.cos(math.radians(first[0])), DEGREE_M
        streets = [
            self._points(way.nodes)
            for way in survey.roads.values()
            if way.road_class in _RESIDENTIAL and not way.closed
        ]
        points = np.concatenate([*streets, np.empty((0, 2))])
        self._streets = cKDTree(points) if len(points) else None
        self._areas = [edges for area in survey.areas if len(edges := self._edges(area))]
        self._boxes = np.array(
            [(*e.min(axis=(0, 1)), *e.max(axis=(0, 1))) for e in self._areas]
        ).reshape(-1, 4)

    @property
    def is_known(self) -> bool:
        """Whether the extract has anything that is built up."""
        return self._streets is not None or bool(self._areas)

    def holds(self, way: Way) -> bool:
        """Whether at least half of a way lies inside of built-up areas."""
        points = self._points(way.nodes)
        if not len(points):
            return False
        inside = np.zeros(len(points), dtype=bool)
        if self._streets is not None:
            inside |= self._streets.query(points, distance_upper_bound=_NEAR_M)[0] <= _NEAR_M
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        box = self._boxes
        close = (box[:, 0] <= x1) & (box[:, 1] <= y1) & (box[:, 2] >= x0) & (box[:, 3] >= y0)
        for number in np.flatnonzero(close):
            inside |= _inside(points, self._areas[number])
        return bool(inside.mean() >= 0.5)

    def _metres(self, nodes: tuple[int, ...]) -> Floats:
        """Places of nodes around the extract's first one, m, over the date line too."""
        found = [self._places[node] for node in nodes if node in self._places]
        degrees = np.array(found, dtype=np.float64).reshape(-1, 2)
        east = (degrees[:, 1] - self._origin[1] + 540.0) % 360.0 - 180.0
        north = degrees[:, 0] - self._origin[0]
        return np.column_stack([east * self._scale[0], north * self._scale[1]])

    def _points(self, nodes: tuple[int, ...]) -> Floats:
        """Points along a line at equal distances."""
        corners = self._metres(nodes)
        if len(corners) <= 1:
            return corners
        lengths = np.hypot(*np.diff(corners, axis=0).T)
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        places = np.linspace(0.0, at[-1], max(2, math.ceil(at[-1] / _STEP_M) + 1))
        return np.column_stack([np.interp(places, at, corners[:, axis]) for axis in (0, 1)])

    def _edges(self, lines: tuple[tuple[int, ...], ...]) -> Floats:
        """Begins and ends of the lines that bound an area, shape (e, 2, 2)."""
        found = [self._metres(line) for line in lines]
        pieces = [np.stack([c[:-1], c[1:]], axis=1) for c in found if len(c) > 1]
        return np.concatenate([*pieces, np.empty((0, 2, 2))])


def _inside(points: Floats, edges: Floats) -> npt.NDArray[np.bool_]:
    """Whether points lie in an area, holes left out: by how many edges lie to the east of each."""
    (x0, y0), (x1, y1) = edges[:, 0].T[:, :, None], edges[:, 1].T[:, :, None]
    x, y = points.T[:, None, :]
    spans = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        east = x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x
    odd: npt.NDArray[np.bool_] = (spans & east).sum(axis=0) % 2 == 1
    return odd
