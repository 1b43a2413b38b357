"""Road networks from SUMO nets."""

from __future__ import annotations

import re
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any, Final, TypeVar
from xml import sax
from xml.sax.saxutils import unescape

from slipstream.config import DEMO_NETWORK as DEMO_NETWORK
from slipstream.errors import InputError
from slipstream.files import open_unpacked
from slipstream.roads.access import access_of, classes_of_turn, warn_of_unread
from slipstream.roads.network import Crossing, RoadNetwork, Segment, build_network
from slipstream.roads.projection import projection_of

T = TypeVar("T")

_YIELDING: Final = "msw="
"""Letters of SUMO's connections that give way: minor, stop, all-way stop, equal."""

_ROAD_CLASSES: Final = frozenset(
    {
        *(f"{name}{link}" for name in ("motorway", "trunk", "primary") for link in ("", "_link")),
        *(f"{name}{link}" for name in ("secondary", "tertiary") for link in ("", "_link")),
        *("unclassified", "residential", "living_street", "service", "road", "unsurfaced"),
        *("pedestrian", "track", "bus_guideway", "busway"),
    }
)
_NO_TUNNEL: Final = frozenset({"no", "building_passage", "covered", "culvert"})
"""Values of OpenStreetMap's `tunnel` of roads where a vehicle can stand."""
_ENTITIES: Final = {"&apos;": "'", "&quot;": '"'}
"""netconvert escapes street names of a map twice."""


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
    return _read_sumo_net(path, net_name(path))


def net_name(path: Path) -> str:
    """A net's name: its file's without the endings, in capitals or not."""
    return re.sub(r"(\.net\.xml)?(\.gz)?$", "", path.name, flags=re.IGNORECASE)


def read_sumo_net(path: Path, read: Callable[[Any], T], *, internal: bool = False) -> T:
    """Read a SUMO net and take from it what is needed.

    Args:
        internal: with the edges inside junctions.

    Raises:
        InputError: there is no such file, it is no SUMO net, or ``read`` fails on it.
    """
    # Imported here: sumolib costs 0.2 s, which a process that only sends messages need not pay.
    import sumolib

    class NetReader(sumolib.net.NetReader):  # type: ignore[misc]
        edge_type = ""

        def startElement(self, name: str, attributes: Any) -> None:
            super().startElement(name, attributes)
            # sumolib leaves out the side that is driven on, and the speed limits by class that an
            # edge type may have.
            if name == "net":
                left = str(attributes.get("lefthand", ""))
                self.getNet().__dict__["left_hand"] = left.lower() in ("1", "true", "t", "yes")
            if name == "type":
                self.edge_type = attributes["id"]
            elif name == "restriction":
                speeds = self.getNet().__dict__.setdefault("type_speeds_mps", {})
                of_type = speeds.setdefault(self.edge_type, {})
                of_type[attributes["vClass"]] = float(attributes["speed"])

    reader = NetReader(withInternal=internal)
    mend = "build one with netconvert"
    try:
        with open_unpacked(path, "give a SUMO net, or 'demo'") as file:
            sax.parse(file, reader)
        return read(reader.getNet())
    except InputError:
        raise
    except Exception as error:  # sumolib takes for granted that all is there and of its type
        problem = f"{type(error).__name__}: {error}".removeprefix("SAXParseException: ")
        raise InputError(path, f"not a SUMO net: {problem}", mend) from None


def _read_sumo_net(path: Path, name: str) -> RoadNetwork:
    parts, crossings, (classes, projection, left_hand) = read_sumo_net(
        path,
        lambda net: (
            _parts(net, str(path)),
            _crossings(net),
            (_turn_classes(net), projection_of(net), bool(net.__dict__.get("left_hand"))),
        ),
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
        left_hand=left_hand,
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


def _road_class(edge_type: str) -> str:
    """OpenStreetMap's road class in the type of an edge ("highway.primary|railway.tram"); ""
    where it has none.
    """
    parts = (part.strip().lower().removeprefix("highway.") for part in edge_type.split("|"))
    return next((part for part in parts if part in _ROAD_CLASSES), "")


def _is_tunnel(value: str) -> bool:
    """By OpenStreetMap's tag; netconvert gives an edge that is made of several ways each value."""
    words = value.replace(";", " ").split()
    return bool(words) and not _NO_TUNNEL.intersection(words)


def _parts(
    net: Any, source: str
) -> tuple[list[Segment], dict[str, tuple[float, float]], dict[str, tuple[str, ...]], set[str]]:
    """Segments, junctions, allowed turns and signals of sumolib's net."""
    edges = [edge for edge in net.getEdges() if not edge.isSpecial()]
    type_speeds = net.__dict__.get("type_speeds_mps", {})
    unread: list[str] = []
    segments = [
        Segment(
            id=edge.getID(),
            start=edge.getFromNode().getID(),
            end=edge.getToNode().getID(),
            length_m=float(edge.getLength()),
            speed_limit_mps=float(edge.getSpeed()),
            lanes=edge.getLaneNumber(),
            shape=tuple((float(x), float(y)) for x, y in edge.getShape()),
            access=access_of(edge, type_speeds, unread),
            name=unescape(edge.getName() or "", _ENTITIES),
            road_class=_road_class(edge.getType() or ""),
            in_tunnel=_is_tunnel(edge.getParam("tunnel") or ""),
        )
        for edge in edges
    ]
    warn_of_unread(source, unread)
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
