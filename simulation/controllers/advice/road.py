"""The road of one leg ahead of its vehicle: where speeds must be low, and where signals stand."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from simulation.controllers.vehicle import VehicleState
from slipstream.roads import read_sumo_net

YIELDING_MPS: Final = 4.0
"""A vehicle that must give way sees crossing traffic 4.5 m before the line, SUMO's value, and must
be able to stop there: √(2 · 2.5 m/s² · 4.5 m) = 4.7 m/s, less what a step takes."""

_YIELDING: Final = "msw="
"""Letters of SUMO's connections that give way: minor, stop, all-way stop, equal."""


@dataclass(frozen=True)
class Crossing:
    """A crossing of a junction, from a lane of one segment to the next segment.

    Attributes:
        length_m: of the lanes through the junction; 0 where there are none.
        speed_mps: the lowest of their limits: the turn's.
        yields: whether it gives way by the rules of the road, without signals.
        tls: the signals that it obeys; None: none.
        link: its index there.
    """

    length_m: float
    speed_mps: float
    tls: str | None
    link: int
    yields: bool = False

    @property
    def passing_mps(self) -> float:
        """Entry speed on an empty junction."""
        return min(self.speed_mps, YIELDING_MPS) if self.yields else self.speed_mps


@dataclass(frozen=True)
class Roads:
    """The parts of a net that speeds depend on.

    Attributes:
        length_m: of each segment.
        limit_mps: of each segment.
        crossings: by segment, next segment and lane.
    """

    length_m: Mapping[str, float]
    limit_mps: Mapping[str, float]
    crossings: Mapping[tuple[str, str], Mapping[int, Crossing]]

    def crossing(self, segment: str, following: str, lane: int) -> Crossing:
        """The crossing from a lane, or from the nearest lane that leads there."""
        ways = self.crossings[segment, following]
        return ways[min(ways, key=lambda other: (abs(other - lane), other))]


def read_roads(net: Path) -> Roads:
    """Read a SUMO net with the lanes inside its junctions.

    Raises:
        InputError: as `slipstream.roads.read_sumo_net`.
    """
    return read_sumo_net(net.absolute(), _roads, internal=True)


def _roads(read: Any) -> Roads:
    edges = [edge for edge in read.getEdges() if not edge.isSpecial()]
    crossings: dict[tuple[str, str], dict[int, Crossing]] = {}
    for edge in edges:
        for following, connections in edge.getOutgoing().items():
            ways = crossings.setdefault((edge.getID(), following.getID()), {})
            for connection in connections:
                lanes = _lanes_through(read, connection)
                tls = connection.getTLSID() or None
                ways.setdefault(
                    connection.getFromLane().getIndex(),
                    Crossing(
                        sum(float(lane.getLength()) for lane in lanes),
                        min(
                            [float(lane.getSpeed()) for lane in lanes],
                            default=float(following.getSpeed()),
                        ),
                        tls,
                        int(connection.getTLLinkIndex()) if tls else -1,
                        tls is None and connection.getState() in _YIELDING,
                    ),
                )
    return Roads(
        {edge.getID(): float(edge.getLength()) for edge in edges},
        {edge.getID(): float(edge.getSpeed()) for edge in edges},
        crossings,
    )


def _lanes_through(net: Any, connection: Any) -> list[Any]:
    """The lanes inside a junction that a connection leads over, one behind another."""
    lanes = []
    via = connection.getViaLaneID()
    while via:
        lane = net.getLane(via)
        lanes.append(lane)
        via = next((onward.getViaLaneID() for onward in lane.getOutgoing()), "")
    return lanes


@dataclass(frozen=True)
class SlowPoint:
    """A place that may not be passed faster than this.

    Attributes:
        at_m: along the leg.
        speed_mps: there; 0: the leg's end.
    """

    at_m: float
    speed_mps: float


@dataclass(frozen=True)
class StopLine:
    """A signal's stop line on a leg.

    Attributes:
        at_m: along the leg.
        tls: the signals.
        link: index of the movement there.
        passing_mps: limit behind it, on the way through the junction.
    """

    at_m: float
    tls: str
    link: int
    passing_mps: float


@dataclass(frozen=True)
class LegRoad:
    """A leg's road, measured from the begin of its first segment.

    Attributes:
        begins_m: of each segment.
        ends_m: of each segment.
        limits_mps: of each segment.
        slow: places where speed must be lower than just before, in order; the last is the end.
        lines: stop lines, in order.
    """

    begins_m: tuple[float, ...]
    ends_m: tuple[float, ...]
    limits_mps: tuple[float, ...]
    slow: tuple[SlowPoint, ...]
    lines: tuple[StopLine, ...]

    @property
    def length_m(self) -> float:
        """Of the whole leg."""
        return self.ends_m[-1]

    def place_m(self, state: VehicleState) -> float:
        """Where a vehicle's front is along the leg."""
        if state.crossing:
            return self.ends_m[state.number] + state.front_m
        return self.begins_m[state.number] + state.front_m

    def slow_ahead(self, place_m: float) -> tuple[SlowPoint, ...]:
        """The places ahead where speed must be lower."""
        return self.slow[bisect_right(self.slow, place_m, key=lambda slow: slow.at_m) :]


def leg_road(roads: Roads, path: Sequence[str], lanes: Mapping[int, int] | None = None) -> LegRoad:
    """Put a leg's road together.

    Args:
        path: its segments.
        lanes: of segments by their number in the path, where it is known which lane is driven.

    Raises:
        KeyError: a segment that the net has not, or two that no lane joins.
    """
    lanes = lanes or {}
    begins, ends, slow, lines = [], [], [], []
    at = 0.0
    for number, segment in enumerate(path):
        begins.append(at)
        at += roads.length_m[segment]
        ends.append(at)
        limit = roads.limit_mps[segment]
        if number + 1 == len(path):
            slow.append(SlowPoint(at, 0.0))
            break
        way = roads.crossing(segment, path[number + 1], lanes.get(number, 0))
        if way.tls is not None:
            lines.append(StopLine(at, way.tls, way.link, min(limit, way.speed_mps)))
        if way.passing_mps < limit:
            slow.append(SlowPoint(at, way.passing_mps))
        at += way.length_m
        onward = roads.limit_mps[path[number + 1]]
        if onward < min(limit, way.speed_mps):
            slow.append(SlowPoint(at, onward))
    limits = tuple(roads.limit_mps[segment] for segment in path)
    return LegRoad(tuple(begins), tuple(ends), limits, tuple(slow), tuple(lines))
