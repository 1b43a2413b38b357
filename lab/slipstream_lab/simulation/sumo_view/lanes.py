"""The roads around an RSU: carriageways and junctions."""

from __future__ import annotations

from dataclasses import dataclass

from slipstream_lab.simulation.sumo_view.polylines import Floats, distances, shifted, stretch


@dataclass(frozen=True)
class Carriageway:
    """The lanes of one edge, which lie side by side.

    Attributes:
        left: left border of the leftmost lane in the direction of travel, m in the net, (n, 2).
        kerb_left: whether the kerb is to the left of the lanes: where the left side is driven on.
    """

    edge: str
    left: Floats
    widths_m: tuple[float, ...]
    walk_m: float
    length_m: float
    stop_line: bool
    kerb_left: bool = False

    def beside_kerb(self, from_m: float, to_m: float) -> tuple[float, float]:
        """Of a strip between two distances beyond the kerb: its distances to the right of the left
        border.
        """
        if self.kerb_left:
            return -to_m, -from_m
        return self.width_m + from_m, self.width_m + to_m

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
class LaneRoads:
    """Carriageways and the outlines (n, 2) of junctions around the RSU, in the net's metres.

    `edges` are all edges of the net, near or far.
    """

    carriageways: tuple[Carriageway, ...]
    junctions: tuple[Floats, ...]
    edges: frozenset[str]

    def find(self, edge: str) -> Carriageway | None:
        """The carriageway of an edge, None if it is not around."""
        return next((way for way in self.carriageways if way.edge == edge), None)
