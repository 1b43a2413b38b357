"""The junctions between the segments of a path: how far and how fast through, and which signal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import NamedTuple

import libsumo


class Link(NamedTuple):
    """A movement's number at its signal."""

    tls: str
    number: int


@dataclass(frozen=True)
class Movement:
    """The movement from one segment to the next.

    Attributes:
        length_m: through the junction; the mean of the lanes that lead there.
        speed_mps: allowed in the junction: what its curve allows, at most the limit.
        turns: whether it is a turn, by SUMO's measure, and not straight on.
        yields: whether it must give way by the rules of the road; at a signal, its greens say so.
        links: lane of the first segment -> its number at the signal; none without a signal.
    """

    length_m: float
    speed_mps: float
    turns: bool
    yields: bool
    links: Mapping[int, Link]


@dataclass(frozen=True)
class Crossing:
    """A signal on a path.

    Attributes:
        number: of the segment in the path whose end it stands at.
        tls: the signal.
        links: lane -> the movement's number at the signal, for the lanes that lead on.
        line_m: of its stop line, from the begin of the path, junctions counted.
        speed_mps: allowed in the junction behind it.
    """

    number: int
    tls: str
    links: Mapping[int, int]
    line_m: float
    speed_mps: float

    def link(self, lane: int) -> int:
        """The movement's number at the signal from a lane; from one that leads on, if it must."""
        found = self.links.get(lane)
        return next(iter(self.links.values())) if found is None else found


class Movements:
    """All movements of the running simulation's net, read when this is made."""

    def __init__(self) -> None:
        self._links = _links()
        self._approaches: dict[str, dict[int, tuple[str, ...]]] = {}
        self._lengths_m: dict[str, float] = {}
        self._limits_mps: dict[str, float] = {}
        self._movements: dict[tuple[str, str], Movement] = {}
        self._onward: dict[str, dict[str, list[tuple[int, float, float, bool, bool]]]] = {}

    def lanes(self, tls: str) -> dict[int, tuple[str, ...]]:
        """The lanes before a signal by the movements that they belong to."""
        known = self._approaches.get(tls)
        if known is None:
            found: dict[int, list[str]] = {}
            for (lane, _), link in self._links.items():
                if link.tls == tls:
                    found.setdefault(link.number, []).append(lane)
            known = {number: tuple(lanes) for number, lanes in found.items()}
            self._approaches[tls] = known
        return known

    def movement(self, before: str, after: str) -> Movement | None:
        """The movement between two segments; None if no lane of the first leads to the second."""
        known = self._movements.get((before, after))
        if known is None:
            ways = self._ways(before).get(after)
            if not ways:
                return None
            known = Movement(
                sum(way[1] for way in ways) / len(ways),
                min(way[2] for way in ways),
                any(way[3] for way in ways),
                any(way[4] for way in ways),
                {
                    way[0]: self._links[f"{before}_{way[0]}", after]
                    for way in ways
                    if (f"{before}_{way[0]}", after) in self._links
                },
            )
            self._movements[before, after] = known
        return known

    def length_m(self, segment: str) -> float:
        """Of a segment, to its stop line."""
        known = self._lengths_m.get(segment)
        if known is None:
            known = self._lengths_m[segment] = float(libsumo.lane.getLength(f"{segment}_0"))
        return known

    def limit_mps(self, segment: str) -> float:
        """Allowed speed on a segment."""
        known = self._limits_mps.get(segment)
        if known is None:
            known = float(libsumo.lane.getMaxSpeed(f"{segment}_0"))
            self._limits_mps[segment] = known
        return known

    def begins_m(self, path: tuple[str, ...]) -> tuple[float, ...]:
        """Where each segment of a path begins, from the begin of the path, junctions counted."""
        steps = [0.0]
        for before, after in pairwise(path):
            movement = self.movement(before, after)
            steps.append(self.length_m(before) + (movement.length_m if movement else 0.0))
        return tuple(accumulate(steps))

    def crossings(self, path: tuple[str, ...]) -> tuple[Crossing, ...]:
        """The signals on a path, in order."""
        found = []
        begins_m = self.begins_m(path)
        for number, (before, after) in enumerate(pairwise(path)):
            movement = self.movement(before, after)
            if movement is None or not movement.links:
                continue
            tls = next(iter(movement.links.values())).tls
            found.append(
                Crossing(
                    number,
                    tls,
                    {lane: link.number for lane, link in movement.links.items()},
                    begins_m[number] + self.length_m(before),
                    movement.speed_mps,
                )
            )
        return tuple(found)

    def _ways(self, before: str) -> dict[str, list[tuple[int, float, float, bool, bool]]]:
        """Segments behind a segment: lane, length, speed, whether it turns, whether it yields."""
        known = self._onward.get(before)
        if known is None:
            known = self._onward[before] = {}
            for lane in range(libsumo.edge.getLaneNumber(before)):
                for link in libsumo.lane.getLinks(f"{before}_{lane}"):
                    target, first, _, _, via, _, direction, _ = link
                    length_m, speed_mps = _through(via)
                    after = target.rpartition("_")[0]
                    yields = not first and (f"{before}_{lane}", after) not in self._links
                    way = (lane, length_m, speed_mps, direction != "s", yields)
                    known.setdefault(after, []).append(way)
        return known


def _links() -> dict[tuple[str, str], Link]:
    """(Lane, segment behind the junction) -> the movement's number at its signal."""
    found: dict[tuple[str, str], Link] = {}
    for tls in libsumo.trafficlight.getIDList():
        for number, group in enumerate(libsumo.trafficlight.getControlledLinks(tls)):
            for before, after, _ in group:
                # Lanes inside a junction belong to pedestrians.
                if not before.startswith(":"):
                    found[before, after.rpartition("_")[0]] = Link(tls, number)
    return found


def _through(via: str) -> tuple[float, float]:
    """Length and allowed speed of the lanes inside a junction, which may be several in a row."""
    length_m, speed_mps = 0.0, float("inf")
    while via.startswith(":"):
        length_m += libsumo.lane.getLength(via)
        speed_mps = min(speed_mps, libsumo.lane.getMaxSpeed(via))
        links = libsumo.lane.getLinks(via)
        via = links[0][4] if links else ""
    return length_m, speed_mps
