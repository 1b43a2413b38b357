"""The road network: directed segments between junctions, and the ways through these."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from slipstream.energy.traction import PAPER_CAR
from slipstream.errors import InputError
from slipstream.roads.access import OPEN, Access
from slipstream.roads.projection import Projection
from slipstream.vehicle_types import RoutingProfile

EXPRESSWAYS: Final = frozenset({"motorway", "trunk"})
EXPRESSWAY_MPS: Final = 25.0
"""A road of no known class counts as an expressway from this limit on: 90 km/h."""


@dataclass(frozen=True)
class Segment:
    """One directed road segment (an edge of a SUMO net).

    Attributes:
        id: name of the segment, the edge's id.
        start: junction that it leaves.
        end: junction that it enters.
        length_m: driven length in m, > 0.
        speed_limit_mps: free-flow speed in m/s, > 0.
        lanes: number of lanes.
        shape: points of its centre line, m, from start to end; at least two.
        access: who may use it.
        name: of its street, for people; "" where the net has none.
        road_class: OpenStreetMap's, such as "primary_link"; "" where the net tells none.
        in_tunnel: whether all of it is.
    """

    id: str
    start: str
    end: str
    length_m: float
    speed_limit_mps: float
    lanes: int
    shape: tuple[tuple[float, float], ...]
    access: Access = OPEN
    name: str = ""
    road_class: str = ""
    in_tunnel: bool = False

    @property
    def free_flow_s(self) -> float:
        """Seconds to drive it at the speed limit."""
        return self.length_m / self.speed_limit_mps

    @property
    def allows_stops(self) -> bool:
        """Whether a vehicle may stand there to serve an address: on no expressway, ramp or slip
        road, and in no tunnel.
        """
        if self.in_tunnel:
            return False
        if self.road_class:
            return not (self.road_class in EXPRESSWAYS or self.road_class.endswith("_link"))
        return self.speed_limit_mps < EXPRESSWAY_MPS


@dataclass(frozen=True)
class Crossing:
    """The way through a junction, from the end of one segment to the begin of the next.

    Attributes:
        length_m: of the lane through it, ≥ 0.
        speed_mps: allowed there, > 0; on several lanes the lowest.
        yields: whether one gives way by the rules of the road, without signals.
        intersection: id of the signals that it obeys (SUMO's tlLogic); None: none.
        signal_groups: by lane of the first segment that leads there, its movement's number at these
            signals (SUMO's link index).
    """

    length_m: float
    speed_mps: float
    yields: bool = False
    intersection: str | None = None
    signal_groups: Mapping[int, int] = field(default_factory=dict)


@dataclass(frozen=True)
class UsableRoads:
    """What of a network vehicles of one profile may use, as arrays; whatever the traffic.

    Attributes:
        ids: of all m segments, sorted.
        index: position by id.
        leaving: positions of the usable segments that leave a junction, by junction.
        entering: the same for those that end there.
        turns: pairs of usable segments (from, onto), shape (2, t).
        length_m: shape (m,).
        limit_mps: what the vehicles may and can drive, shape (m,).
    """

    ids: tuple[str, ...]
    index: Mapping[str, int]
    leaving: Mapping[str, list[int]]
    entering: Mapping[str, list[int]]
    turns: npt.NDArray[np.int64]
    length_m: npt.NDArray[np.float64]
    limit_mps: npt.NDArray[np.float64]


@dataclass(frozen=True)
class RoadNetwork:
    """Segments by id and junction positions in m; immutable.

    ``follows`` maps a segment to the segments that a vehicle may turn into at its end; ``signals``
    are the junctions with traffic lights; ``crossings`` are the ways through junctions, by the
    segments before and behind, as far as they are known; ``turn_classes`` are the vehicle classes
    that may take a turn, where not all may; ``projection`` leads from latitude and longitude to its
    places, if the network has one; ``left_hand`` is whether the left side is driven on.
    """

    name: str
    segments: Mapping[str, Segment]
    junctions: Mapping[str, tuple[float, float]]
    follows: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    signals: frozenset[str] = frozenset()
    crossings: Mapping[tuple[str, str], Crossing] = field(default_factory=dict)
    turn_classes: Mapping[tuple[str, str], frozenset[str]] = field(default_factory=dict)
    projection: Projection | None = None
    left_hand: bool = False

    def admits(self, segment: str, profile: RoutingProfile) -> bool:
        """Whether vehicles of a profile may use a segment."""
        return self.segments[segment].access.admits(profile)

    def admits_turn(self, segment: str, onto: str, profile: RoutingProfile) -> bool:
        """Whether vehicles of a profile may turn from a segment onto another one."""
        classes = self.turn_classes.get((segment, onto))
        return classes is None or profile.vehicle_class in classes

    @cached_property
    def is_restricted(self) -> bool:
        """Whether some vehicles may not use some segment or turn."""
        return bool(self.turn_classes) or any(
            replace(segment.access, class_speeds_mps={}) != OPEN
            for segment in self.segments.values()
        )

    @cached_property
    def leaving(self) -> Mapping[str, tuple[Segment, ...]]:
        """Segments that leave each junction, by junction id."""
        leaving: dict[str, list[Segment]] = {name: [] for name in self.junctions}
        for segment in self.segments.values():
            leaving[segment.start].append(segment)
        return MappingProxyType({name: tuple(group) for name, group in leaving.items()})

    @cached_property
    def intersections(self) -> tuple[str, ...]:
        """Ids of the signals that ways through junctions obey, sorted."""
        found = {crossing.intersection for crossing in self.crossings.values()}
        return tuple(sorted(name for name in found if name is not None))

    def turns(self, segment: str) -> tuple[str, ...]:
        """Segments that a vehicle may drive on into without stopping; all where none is known."""
        known = self.follows.get(segment)
        if known is not None:
            return known
        return tuple(s.id for s in self.leaving[self.segments[segment].end])

    @cached_property
    def _usable(self) -> dict[RoutingProfile, UsableRoads]:
        return {}

    def usable(self, profile: RoutingProfile) -> UsableRoads:
        """What vehicles of a profile may use; computed once for all whose energies alone differ."""
        key = replace(profile, physics=PAPER_CAR, drafting="paper")
        if key not in self._usable:
            self._usable[key] = _usable_roads(self, key)
        return self._usable[key]

    def bounds_m(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) over all segment shapes, m."""
        points: npt.NDArray[np.float64] = np.array(
            [point for segment in self.segments.values() for point in segment.shape]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _usable_roads(network: RoadNetwork, profile: RoutingProfile) -> UsableRoads:
    ids = tuple(sorted(network.segments))
    index = {name: i for i, name in enumerate(ids)}
    leaving: dict[str, list[int]] = {node: [] for node in network.junctions}
    entering: dict[str, list[int]] = {node: [] for node in network.junctions}
    usable = {name for name in ids if network.admits(name, profile)}
    for i, name in enumerate(ids):
        if name in usable:
            leaving[network.segments[name].start].append(i)
            entering[network.segments[name].end].append(i)
    pairs = [
        (index[a], index[b])
        for a in ids
        for b in dict.fromkeys(network.turns(a))
        if a in usable and b in usable and network.admits_turn(a, b, profile)
    ]
    segments = [network.segments[name] for name in ids]
    limits = [s.access.speed_limit_mps(s.speed_limit_mps, profile) for s in segments]
    top_mps = math.inf if profile.max_speed_mps is None else profile.max_speed_mps
    return UsableRoads(
        ids,
        index,
        leaving,
        entering,
        np.array(pairs, dtype=np.int64).reshape(-1, 2).T,
        np.array([segment.length_m for segment in segments]),
        np.minimum(limits, top_mps),
    )


def build_network(
    name: str,
    segments: Iterable[Segment],
    junctions: Mapping[str, tuple[float, float]],
    follows: Mapping[str, tuple[str, ...]] | None = None,
    *,
    signals: Iterable[str] = (),
    crossings: Mapping[tuple[str, str], Crossing] | None = None,
    turn_classes: Mapping[tuple[str, str], frozenset[str]] | None = None,
    projection: Projection | None = None,
    left_hand: bool = False,
    source: str = "network",
    prefix: str = "",
) -> RoadNetwork:
    """Check the parts and put them together.

    Args:
        follows: allowed turns; None allows every turn but the U-turn onto the way back.
        crossings: ways through junctions; those of turns that `follows` has not are left out.
        turn_classes: vehicle classes of turns that not all may take.
        source: what errors name.
        prefix: put before the segments' ids in errors, where they are part of a larger file.

    Raises:
        InputError: duplicate ids, unknown junctions, a place that is not finite, a length or speed
            that is not positive, or a turn onto a segment that does not begin where the other one
            ends.
    """
    for junction, place in junctions.items():
        if not all(map(math.isfinite, place)):
            raise InputError(source, f"junction {junction!r} is nowhere", "give it a finite place")
    by_id: dict[str, Segment] = {}
    for segment in segments:
        key = prefix + segment.id
        if segment.id in by_id:
            raise InputError(source, "two segments with this id", "rename one", key=key)
        for end in (segment.start, segment.end):
            if end not in junctions:
                raise InputError(source, f"unknown junction {end!r}", "add it", key=key)
        for value, what in ((segment.length_m, "length"), (segment.speed_limit_mps, "speed")):
            if not (math.isfinite(value) and value > 0):
                raise InputError(source, f"{what} is {value}", "give it > 0", key=key)
        if not all(math.isfinite(x + y) for x, y in segment.shape):
            raise InputError(source, "a shape without a place", "give finite numbers", key=key)
        by_id[segment.id] = segment
    if follows is None:
        leaving: dict[str, list[Segment]] = {}
        for segment in by_id.values():
            leaving.setdefault(segment.start, []).append(segment)
        follows = {
            a.id: tuple(sorted(b.id for b in leaving.get(a.end, ()) if b.end != a.start))
            for a in by_id.values()
        }
    for before, onto in follows.items():
        key = prefix + before
        for known in (before, *onto):
            if known not in by_id:
                problem = f"a turn names the unknown segment {known!r}"
                raise InputError(source, problem, "add it", key=key)
        for after in onto:
            if by_id[after].start != by_id[before].end:
                problem = f"a turn onto {after!r}, which begins elsewhere"
                raise InputError(source, problem, "remove the turn", key=key)
    return RoadNetwork(
        name,
        MappingProxyType(by_id),
        MappingProxyType(dict(junctions)),
        MappingProxyType(dict(follows)),
        frozenset(signals),
        MappingProxyType(
            {
                (a, b): crossing
                for (a, b), crossing in (crossings or {}).items()
                if b in follows.get(a, ())
            }
        ),
        MappingProxyType(dict(turn_classes or {})),
        projection,
        left_hand,
    )
