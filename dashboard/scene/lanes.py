"""Strokes of many routes at once: all roads of a network lie in flat arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dashboard.scene import geometry
from dashboard.scene.geometry import Array
from slipstream.roads import RoadNetwork

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Drawing:
    """Strokes to draw.

    Attributes:
        strokes: (N, 2, 2), start and end of each, m.
        part: (N,), which of the driven roads each belongs to.
    """

    strokes: Array
    part: Indices


class Lanes:
    """Computes strokes of any choice of roads, each at its own offset, without a loop over them.

    Args:
        network: the road network.
        arrow_every_m: distance between the arrows along a road, m; each road has at least one.
        arrow_m: size of an arrow, m.

    Attributes:
        index: index of each segment by its name, as in ``roads`` of the methods below.
    """

    def __init__(self, network: RoadNetwork, arrow_every_m: float, arrow_m: float) -> None:
        self.index = {name: index for index, name in enumerate(network.segments)}
        self._arrow_m = arrow_m
        lines = [geometry.drop_repeated_points(road.shape) for road in network.segments.values()]
        self._points = np.concatenate(lines)
        side = -1 if network.left_hand else 1
        self._normals = side * np.concatenate([geometry.right_normals(line) for line in lines])
        self._first_point = _starts([len(line) for line in lines])
        marks = [_arrow_places(line, arrow_every_m) for line in lines]
        self._first_arrow = _starts([len(stroke) for stroke, _ in marks])
        self._arrow_stroke = np.concatenate([stroke for stroke, _ in marks])
        self._arrow_fraction = np.concatenate([fraction for _, fraction in marks])

    def road_strokes(self, roads: Indices, lanes_m: Array) -> Drawing:
        """The roads' lines.

        Args:
            roads: (K,), numbers of segments.
            lanes_m: (K,), how far beside each road, on the side that is driven on, m.
        """
        starts = self._first_point[roads]
        counts = self._first_point[roads + 1] - starts - 1
        part = np.repeat(np.arange(len(roads)), counts)
        point = starts[part] + _count_up(counts)
        lane_m = lanes_m[part]
        ends = (self._place(point, lane_m), self._place(point + 1, lane_m))
        return Drawing(np.stack(ends, axis=1), part)

    def junction_strokes(self, roads: Indices, lanes_m: Array, before: Indices) -> Drawing:
        """Strokes over the junctions, from the end of a road to the start of the one after it.

        Args:
            before: (N,), positions in ``roads`` of those that the next one is driven after.
        """
        after = before + 1
        ends = (
            self._place(self._first_point[roads[before] + 1] - 1, lanes_m[before]),
            self._place(self._first_point[roads[after]], lanes_m[after]),
        )
        return Drawing(np.stack(ends, axis=1), after)

    def arrow_strokes(self, roads: Indices, lanes_m: Array) -> Drawing:
        """Arrowheads in the roads' directions, two strokes each."""
        starts = self._first_arrow[roads]
        counts = self._first_arrow[roads + 1] - starts
        part = np.repeat(np.arange(len(roads)), counts)
        arrow = starts[part] + _count_up(counts)
        point = self._first_point[roads[part]] + self._arrow_stroke[arrow]
        fraction, lane_m = self._arrow_fraction[arrow][:, None], lanes_m[part]
        start, end = self._place(point, lane_m), self._place(point + 1, lane_m)
        # The road's own direction: a lane inside a tight bend may shrink to zero length.
        step = self._points[point + 1] - self._points[point]
        ahead = step / np.linalg.norm(step, axis=1, keepdims=True)
        heads = geometry.arrowheads(start + fraction * (end - start), ahead, self._arrow_m)
        return Drawing(heads, np.repeat(part, 2))

    def _place(self, point: Indices, lane_m: Array) -> Array:
        place: Array = self._points[point] + lane_m[:, None] * self._normals[point]
        return place


def _starts(counts: list[int]) -> Indices:
    """Start of each run in their concatenation, and the end of the last."""
    return np.concatenate(([0], np.cumsum(counts, dtype=np.int64)))


def _count_up(counts: Indices) -> Indices:
    """The ranges 0 … count − 1, concatenated."""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _arrow_places(line: Array, every_m: float) -> tuple[Indices, Array]:
    """The stroke of each arrow of a line, and the fraction of the stroke before the arrow."""
    ends = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))))
    count = max(1, int(ends[-1] // every_m))
    goals = (np.arange(count) + 0.5) / count * ends[-1]
    stroke = np.clip(np.searchsorted(ends, goals) - 1, 0, len(line) - 2)
    return stroke, (goals - ends[stroke]) / (ends[stroke + 1] - ends[stroke])
