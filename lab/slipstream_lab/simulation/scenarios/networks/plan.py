"""A road network before it is a SUMO net: junctions, roads and turns, and SUMO's plain files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import quoteattr

from slipstream.errors import InputError

Control = Literal["signals", "priority", "gateway"]
"""Control of a junction; a gateway is an end of the model, where traffic may turn around."""

_NODE_TYPES: dict[str, str] = {
    "signals": "traffic_light",
    "priority": "priority",
    "gateway": "priority",
}


@dataclass(frozen=True)
class Junction:
    """A junction.

    Attributes:
        x: longitude in degrees, or m; as the plan says.
        y: latitude in degrees, or m.
    """

    id: str
    x: float
    y: float
    control: Control


@dataclass(frozen=True)
class PlannedRoad:
    """One direction of a road. `shape`: points between its ends, as the plan counts them; straight
    if there are none.
    """

    id: str
    start: str
    end: str
    lanes: int
    speed_mps: float
    priority: int
    street: str = ""
    shape: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Turn:
    """An allowed turn from one lane onto another. `speed_mps`: limit on it; None: what netconvert
    derives from how narrow it is.
    """

    before: str
    after: str
    from_lane: int
    change_lane: int
    speed_mps: float | None = None


@dataclass(frozen=True)
class NetworkPlan:
    """What a net is built from.

    Attributes:
        turns: those of the roads that have any here; the others' are SUMO's choice.
        geographic: whether positions are degrees of WGS 84, to be projected, or m.
    """

    name: str
    junctions: tuple[Junction, ...]
    roads: tuple[PlannedRoad, ...]
    turns: tuple[Turn, ...] = ()
    geographic: bool = False

    def check(self, source: str | Path) -> None:
        """Check that the parts fit each other. Raises InputError: an id twice, a road to nowhere
        or from a junction to itself, a number of lanes or a speed that is not positive.
        """
        for what, ids in (
            ("junction", [j.id for j in self.junctions]),
            ("road", [r.id for r in self.roads]),
        ):
            twice = next((name for name, count in Counter(ids).items() if count > 1), None)
            if twice is not None:
                raise InputError(source, f"two {what}s with this id", "remove one", key=twice)
        known = {junction.id for junction in self.junctions}
        for road in self.roads:
            missing = next((end for end in (road.start, road.end) if end not in known), None)
            if missing is not None:
                raise InputError(source, f"no junction {missing!r}", "add it", key=road.id)
            if road.start == road.end:
                raise InputError(source, "a road to where it starts", "remove it", key=road.id)
            if road.lanes < 1 or not road.speed_mps > 0:
                problem = f"{road.lanes} lanes at {road.speed_mps:g} m/s"
                raise InputError(source, problem, "give both > 0", key=road.id)


def write_plain(plan: NetworkPlan, folder: Path) -> list[str]:
    """Write SUMO's plain files of a plan into a folder."""
    nodes = (
        f"<node id={quoteattr(j.id)} x={_number(j.x)} y={_number(j.y)} "
        f'type="{_NODE_TYPES[j.control]}"/>'
        for j in plan.junctions
    )
    edges = (
        f"<edge id={quoteattr(r.id)} from={quoteattr(r.start)} to={quoteattr(r.end)} "
        f'numLanes="{r.lanes}" speed={_number(r.speed_mps)} priority="{r.priority}" '
        f"name={quoteattr(r.street)}{_shape(plan, r)}/>"
        for r in plan.roads
    )
    turns = (
        f"<connection from={quoteattr(t.before)} to={quoteattr(t.after)} "
        f'fromLane="{t.from_lane}" toLane="{t.change_lane}"{_speed(t)}/>'
        for t in plan.turns
    )
    options = []
    for option, root, suffix, lines in (
        ("--node-files", "nodes", "nod", nodes),
        ("--edge-files", "edges", "edg", edges),
        ("--connection-files", "connections", "con", turns),
    ):
        path = folder / f"{plan.name}.{suffix}.xml"
        _write(path, root, lines)
        options += [option, str(path)]
    return options


def _shape(plan: NetworkPlan, road: PlannedRoad) -> str:
    if not road.shape:
        return ""
    places = {junction.id: (junction.x, junction.y) for junction in plan.junctions}
    points = (places[road.start], *road.shape, places[road.end])
    text = " ".join(f"{x:.7g},{y:.7g}" for x, y in points)
    return f' shape="{text}"'


def _speed(turn: Turn) -> str:
    return "" if turn.speed_mps is None else f" speed={_number(turn.speed_mps)}"


def _number(value: float) -> str:
    return f'"{value:.10g}"'


def _write(path: Path, root: str, lines: Iterable[str]) -> None:
    inner = "".join(f"    {line}\n" for line in lines)
    path.write_text(f"<{root}>\n{inner}</{root}>\n", encoding="utf-8")
