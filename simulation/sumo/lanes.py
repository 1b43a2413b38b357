"""The roads around the RSU, read from the running simulation: carriageways and junctions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import libsumo
import numpy as np

from simulation.sumo.lines import Floats, clean, distances, nearest_m, shifted, stretch

_WALKERS: Final = ("pedestrian",)
_MUST_STOP: Final = frozenset("rRyYgGoOmsZ")
"""States of a connection behind which vehicles may have to wait."""


@dataclass(frozen=True)
class Carriageway:
    """The lanes of one edge, which lie side by side.

    Attributes:
        edge: SUMO's id.
        left: left border of the leftmost lane in the direction of travel, m in the net, (n, 2).
        widths_m: widths of the lanes from the left to the right.
        walk_m: width of pavements for pedestrians to the right of the lanes.
        length_m: driven length, along which SUMO gives positions.
        stop_line: whether vehicles may have to wait at its end.
    """

    edge: str
    left: Floats
    widths_m: tuple[float, ...]
    walk_m: float
    length_m: float
    stop_line: bool

    @property
    def width_m(self) -> float:
        """Width of all lanes."""
        return sum(self.widths_m)

    def part(self, from_m: float, to_m: float, right_m: float) -> Floats:
        """A line at a distance to the right of the left border, between two driven distances."""
        line = shifted(self.left, -right_m)
        ratio = float(distances(line)[-1]) / self.length_m
        return stretch(line, from_m * ratio, to_m * ratio)


@dataclass(frozen=True)
class Roads:
    """Carriageways and the outlines (n, 2) of junctions around the RSU, in the net's metres."""

    carriageways: tuple[Carriageway, ...]
    junctions: tuple[Floats, ...]

    def find(self, edge: str) -> Carriageway | None:
        """The carriageway of an edge, None if it is not around."""
        return next((way for way in self.carriageways if way.edge == edge), None)


def is_edge(name: str) -> bool:
    """Whether the net has this edge."""
    return name in libsumo.edge.getIDList()


def read_roads(x_m: float, y_m: float, radius_m: float) -> Roads:
    """The roads within a distance of a point of the running simulation's net."""
    centre = np.array([x_m, y_m])
    ways = []
    for edge in libsumo.edge.getIDList():
        if edge.startswith(":"):
            continue
        lanes = [f"{edge}_{i}" for i in range(libsumo.edge.getLaneNumber(edge))]
        shape = clean(np.array(libsumo.lane.getShape(lanes[0]))[:, :2])
        if len(shape) > 1 and nearest_m(shape, centre) <= radius_m:
            way = _carriageway(edge, lanes)
            if way is not None:
                ways.append(way)
    junctions = []
    for name in libsumo.junction.getIDList():
        outline = np.array(libsumo.junction.getShape(name), dtype=np.float64).reshape(-1, 2)
        near = len(outline) > 3 and np.linalg.norm(outline - centre, axis=1).min() <= radius_m
        if near and not name.startswith(":"):
            junctions.append(outline)
    return Roads(tuple(ways), tuple(junctions))


def _carriageway(edge: str, lanes: list[str]) -> Carriageway | None:
    """The edge's lanes for vehicles, None if it has none."""
    walks = [lane for lane in lanes if tuple(libsumo.lane.getAllowed(lane)) == _WALKERS]
    driven = [lane for lane in lanes if lane not in walks]
    if not driven:
        return None
    # SUMO counts lanes from the right.
    leftmost = driven[-1]
    line = clean(np.array(libsumo.lane.getShape(leftmost), dtype=np.float64)[:, :2])
    if len(line) < 2:
        return None
    widths = tuple(float(libsumo.lane.getWidth(lane)) for lane in reversed(driven))
    return Carriageway(
        edge,
        shifted(line, widths[0] / 2),
        widths,
        sum(float(libsumo.lane.getWidth(lane)) for lane in walks),
        float(libsumo.lane.getLength(leftmost)),
        any(_waits(link) for lane in driven for link in libsumo.lane.getLinks(lane)),
    )


def _waits(link: tuple[Any, ...]) -> bool:
    state, direction = link[5], link[6]
    return state in _MUST_STOP and direction != "t"
