"""The part of a road segment that a camera watches: a polygon on the road plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from edge_daemon.camera.homography import Array


@dataclass(frozen=True)
class WatchedSegment:
    """A watched part of a road segment in its own coordinates. Segments may overlap: a vehicle in
    the overlap counts in each of them.

    Attributes:
        polygon_m: outline on the road plane, m, shape (n, 2).
        direction: unit vector of travel, shape (2,).
        length_m: extent along the direction.
    """

    id: str
    polygon_m: Array
    direction: Array
    length_m: float
    lanes: int
    lane_width_m: float

    def contains(self, points_m: Array) -> npt.NDArray[np.bool_]:
        """Which points (n, 2), m, lie inside the outline, by the even-odd rule, NaN not; on an edge
        that two segments share a point lies in one of them.
        """
        (x0, y0, y1), run, rise = self._edges
        x, y = points_m.T
        crossed = (y0 > y) != (y1 > y)
        right = crossed & ((run * (y - y0) > rise * (x - x0)) == (rise > 0))
        return np.asarray(right.sum(axis=0) % 2 == 1)

    @cached_property
    def _edges(self) -> tuple[Array, Array, Array]:
        """(x0, y0, y1) of the outline's edges, and their extents in x and y, each (edges, 1)."""
        begin, end = self.polygon_m, np.roll(self.polygon_m, -1, axis=0)
        run, rise = (end - begin).T[:, :, None]
        return np.stack([begin[:, :1], begin[:, 1:], end[:, 1:]]), run, rise

    def along(self, points_m: Array) -> Array:
        """Position along the direction of travel, m, shape (n,)."""
        return np.asarray(points_m @ self.direction)

    @cached_property
    def begin_m(self) -> float:
        """Position of the outline's upstream end, as `along` counts."""
        return float(self.along(self.polygon_m).min())

    @property
    def end_m(self) -> float:
        """Position of its downstream end."""
        return self.begin_m + self.length_m

    def lane(self, points_m: Array) -> npt.NDArray[np.int_]:
        """Lane index of points (n, 2), counted from the right edge of the outline."""
        offset = points_m @ self.left - self.right_edge_m
        lanes = np.clip(np.floor(offset / self.lane_width_m), 0, self.lanes - 1)
        return np.asarray(lanes, dtype=np.int_)

    @cached_property
    def left(self) -> Array:
        """Unit vector across the direction of travel, to the left, shape (2,)."""
        return np.array([-self.direction[1], self.direction[0]])

    @cached_property
    def right_edge_m(self) -> float:
        """Position of the outline's right edge across the direction of travel, m."""
        return float((self.polygon_m @ self.left).min())
