"""The road network: directed segments between junctions, read from a SUMO net."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeVar
from xml import sax

import numpy as np
import numpy.typing as npt

from slipstream.access import OPEN, Access, access_of, classes_of_turn
from slipstream.errors import InputError
from slipstream.files import open_unpacked
from slipstream.projection import Projection, projection_of
from slipstream.vehicle_types import RoutingProfile

T = TypeVar("T")

DEMO_NETWORK = "demo"
_YIELDING: Final = "msw="
"""Letters of SUMO's connections that give way: minor, stop, all-way stop, equal."""

MAX_NET_BYTES: Final = 64_000_000
MAX_NET_ELEMENTS: Final = 300_000
"""Of a SUMO net, unpacked. Troy's has 0.9 MB and 7,100 elements; one costs sumolib some 15 µs and
1 kB."""


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
    """

    id: str
    start: str
    end: str
    length_m: float
    speed_limit_mps: float
    lanes: int
    shape: tuple[tuple[float, float], ...]
    access: Access = OPEN

    @property
    def free_flow_s(self) -> float:
        """Seconds to drive it at the speed limit."""
        return self.length_m / self.speed_limit_mps


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
class RoadNetwork:
    """Segments by id and junction positions in m; immutable.

    ``follows`` maps a segment to the segments that a vehicle may turn into at its end; ``signals``
    are the junctions with traffic lights; ``crossings`` are the ways through junctions, by the
    segments before and behind, as far as they are known; ``turn_classes`` are the vehicle classes
    that may take a turn, where not all may; ``projection`` leads from latitude and longitude to its
    places, if the network has one.
    """

    name: str
    segments: Mapping[str, Segment]
    junctions: Mapping[str, tuple[float, float]]
    follows: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    signals: frozenset[str] = frozenset()
    crossings: Mapping[tuple[str, str], Crossing] = field(default_factory=dict)
    turn_classes: Mapping[tuple[str, str], frozenset[str]] = field(default_factory=dict)
    projection: Projection | None = None

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

    def turns(self, segment: str) -> tuple[str, ...]:
        """Segments that a vehicle may drive on into without stopping; all where none is known."""
        known = self.follows.get(segment)
        if known is not None:
            return known
        return tuple(s.id for s in self.leaving[self.segments[segment].end])

    def bounds_m(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) over all segment shapes, m."""
        points: npt.NDArray[np.float64] = np.array(
            [point for segment in self.segments.values() for point in segment.shape]
        )
        low, high = points.min(axis=0), points.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def load_network(reference: str | Path) -> RoadNetwork:
    """Read a road network.

    Args:
        reference: path of a SUMO net (``.net.xml`` or ``.net.xml.gz``), or ``"demo"`` for the
            network that is built in.

    Raises:
        InputError: the file is missing, no SUMO net, or holds a segment without a length or speed.
    """
    if str(reference) == DEMO_NETWORK:
        with resources.as_file(resources.files("slipstream") / "data" / "demo.net.xml") as path:
            return _read_sumo_net(path, DEMO_NETWORK)
    path = Path(reference).absolute()
    return _read_sumo_net(path, path.name.removesuffix(".gz").removesuffix(".net.xml"))


def read_sumo_net(path: Path, read: Callable[[Any], T], *, internal: bool = False) -> T:
    """Read a SUMO net and take from it what is needed.

    Args:
        path: packed with gzip or not.
        read: a function of sumolib's net.
        internal: with the edges inside junctions.

    Raises:
        InputError: there is no such file, it is no SUMO net or too large, or ``read`` fails on it.
    """
    # Imported here: sumolib costs 0.2 s, which a process that only sends messages need not pay.
    import sumolib

    class BoundedReader(sumolib.net.NetReader):  # type: ignore[misc]
        elements = 0
        edge_type = ""

        def startElement(self, name: str, attributes: Any) -> None:
            self.elements += 1
            if self.elements > MAX_NET_ELEMENTS:
                problem = f"more than {MAX_NET_ELEMENTS} elements"
                raise InputError(path, problem, "give a smaller net")
            super().startElement(name, attributes)
            # sumolib leaves out the speed limits by class that an edge type may have.
            if name == "type":
                self.edge_type = attributes["id"]
            elif name == "restriction":
                speeds = self.getNet().__dict__.setdefault("type_speeds_mps", {})
                of_type = speeds.setdefault(self.edge_type, {})
                of_type[attributes["vClass"]] = float(attributes["speed"])

    reader = BoundedReader(withInternal=internal)
    mend = "build one with netconvert"
    try:
        with open_unpacked(path, MAX_NET_BYTES, "give a SUMO net, or 'demo'") as file:
            sax.parse(file, reader)
        return read(reader.getNet())
    except InputError:
        raise
    except Exception as error:  # sumolib takes for granted that all is there and of its type
        problem = f"{type(error).__name__}: {error}".removeprefix("SAXParseException: ")
        raise InputError(path, f"not a SUMO net: {problem}", mend) from None


def _read_sumo_net(path: Path, name: str) -> RoadNetwork:
    parts, crossings, (classes, projection) = read_sumo_net(
        path,
        lambda net: (_parts(net), _crossings(net), (_turn_classes(net), projection_of(net))),
        internal=True,
    )
    if not parts[0]:
        raise InputError(path, "no road segment in it", "build one with netconvert")
    segments, junctions, follows, signals = parts
    return build_network(
        name,
        segments,
        junctions,
        follows,
        signals=signals,
        crossings=crossings,
        turn_classes=classes,
        projection=projection,
        source=str(path),
    )


def _turn_classes(net: Any) -> dict[tuple[str, str], frozenset[str]]:
    """Vehicle classes of the turns of sumolib's net that not all may take."""
    found: dict[tuple[str, str], frozenset[str]] = {}
    for edge in net.getEdges():
        for following, connections in edge.getOutgoing().items():
            if not (edge.isSpecial() or following.isSpecial()):
                classes = classes_of_turn(connections)
                if classes is not None:
                    found[edge.getID(), following.getID()] = classes
    return found


def _crossings(net: Any) -> dict[tuple[str, str], Crossing]:
    """Ways through the junctions of sumolib's net, which must have been read with its internals."""
    found: dict[tuple[str, str], Crossing] = {}
    for edge in net.getEdges():
        if edge.isSpecial():
            continue
        for following, connections in edge.getOutgoing().items():
            if following.isSpecial():
                continue
            by_lane = sorted(connections, key=lambda c: int(c.getFromLane().getIndex()))
            first = by_lane[0]
            inside = [_lanes_through(net, connection) for connection in by_lane]
            speeds = [float(lane.getSpeed()) for lanes in inside for lane in lanes]
            signals = first.getTLSID() or None
            found[edge.getID(), following.getID()] = Crossing(
                sum(float(lane.getLength()) for lane in inside[0]),
                min(speeds, default=float(following.getSpeed())),
                yields=signals is None and first.getState() in _YIELDING,
                intersection=signals,
                signal_groups={}
                if signals is None
                else {int(c.getFromLane().getIndex()): int(c.getTLLinkIndex()) for c in by_lane},
            )
    return found


def _lanes_through(net: Any, connection: Any) -> list[Any]:
    """The lanes inside a junction that a connection leads over, one behind another."""
    lanes = []
    via = connection.getViaLaneID()
    while via:
        lane = net.getLane(via)
        lanes.append(lane)
        via = next((onward.getViaLaneID() for onward in lane.getOutgoing()), "")
    return lanes


def _parts(
    net: Any,
) -> tuple[list[Segment], dict[str, tuple[float, float]], dict[str, tuple[str, ...]], set[str]]:
    """Segments, junctions, allowed turns and signals of sumolib's net."""
    edges = [edge for edge in net.getEdges() if not edge.isSpecial()]
    type_speeds = net.__dict__.get("type_speeds_mps", {})
    segments = [
        Segment(
            id=edge.getID(),
            start=edge.getFromNode().getID(),
            end=edge.getToNode().getID(),
            length_m=float(edge.getLength()),
            speed_limit_mps=float(edge.getSpeed()),
            lanes=edge.getLaneNumber(),
            shape=tuple((float(x), float(y)) for x, y in edge.getShape()),
            access=access_of(edge, type_speeds),
        )
        for edge in edges
    ]
    known = {segment.id for segment in segments}
    follows = {
        edge.getID(): tuple(sorted(known & {out.getID() for out in edge.getOutgoing()}))
        for edge in edges
    }
    # In the order of the segments, whatever else of the net was read: seeds draw junctions by it.
    ends = (node for edge in edges for node in (edge.getFromNode(), edge.getToNode()))
    nodes = {node.getID(): node for node in (*ends, *net.getNodes())}
    junctions = {
        name: (float(node.getCoord()[0]), float(node.getCoord()[1])) for name, node in nodes.items()
    }
    signals = {
        node.getID() for node in net.getNodes() if node.getType().startswith("traffic_light")
    }
    return segments, junctions, follows, signals


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
    source: str = "network",
    prefix: str = "",
) -> RoadNetwork:
    """Check the parts and put them together.

    Args:
        follows: allowed turns; None allows every turn but the U-turn onto the way back.
        signals: junctions with traffic lights.
        crossings: ways through junctions; those of turns that `follows` has not are left out.
        turn_classes: vehicle classes of turns that not all may take.
        projection: from latitude and longitude to places.
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
    )
