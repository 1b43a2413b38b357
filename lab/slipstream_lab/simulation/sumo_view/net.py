"""Reads the roads around an RSU from the running simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import libsumo
import numpy as np

from slipstream_lab.simulation.sumo import elements
from slipstream_lab.simulation.sumo_view.lanes import Carriageway, LaneRoads
from slipstream_lab.simulation.sumo_view.polylines import clean, nearest_m, shifted

_WALKERS: Final = ("pedestrian",)
_MUST_STOP: Final = frozenset("rRyYgGoOmsZ")
"""States of a connection behind which vehicles may have to wait."""


def read_roads(x_m: float, y_m: float, radius_m: float) -> LaneRoads:
    """The roads within a distance of a point of the running simulation's net."""
    centre = np.array([x_m, y_m])
    root = next(elements(Path(libsumo.simulation.getOption("net-file")), "start"))
    left_hand = root.get("lefthand", "") in ("1", "true")
    ways = []
    for edge in libsumo.edge.getIDList():
        if edge.startswith(":"):
            continue
        lanes = [f"{edge}_{i}" for i in range(libsumo.edge.getLaneNumber(edge))]
        shape = clean(np.array(libsumo.lane.getShape(lanes[0]))[:, :2])
        if len(shape) > 1 and nearest_m(shape, centre) <= radius_m:
            way = _carriageway(edge, lanes, left_hand)
            if way is not None:
                ways.append(way)
    junctions = []
    for name in libsumo.junction.getIDList():
        outline = np.array(libsumo.junction.getShape(name), dtype=np.float64).reshape(-1, 2)
        near = len(outline) > 3 and np.linalg.norm(outline - centre, axis=1).min() <= radius_m
        if near and not name.startswith(":"):
            junctions.append(outline)
    return LaneRoads(tuple(ways), tuple(junctions), frozenset(libsumo.edge.getIDList()))


def _carriageway(edge: str, lanes: list[str], left_hand: bool) -> Carriageway | None:
    """The edge's lanes for vehicles, None if it has none."""
    walks = [lane for lane in lanes if tuple(libsumo.lane.getAllowed(lane)) == _WALKERS]
    driven = [lane for lane in lanes if lane not in walks]
    if not driven:
        return None
    # SUMO counts lanes from the kerb.
    from_left = driven if left_hand else driven[::-1]
    leftmost = from_left[0]
    line = clean(np.array(libsumo.lane.getShape(leftmost), dtype=np.float64)[:, :2])
    if len(line) < 2:
        return None
    widths = tuple(float(libsumo.lane.getWidth(lane)) for lane in from_left)
    return Carriageway(
        edge,
        shifted(line, widths[0] / 2),
        widths,
        sum(float(libsumo.lane.getWidth(lane)) for lane in walks),
        float(libsumo.lane.getLength(leftmost)),
        any(_waits(link) for lane in driven for link in libsumo.lane.getLinks(lane)),
        left_hand,
    )


def _waits(link: tuple[Any, ...]) -> bool:
    state, direction = link[5], link[6]
    return state in _MUST_STOP and direction != "t"
