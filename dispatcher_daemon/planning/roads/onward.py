"""Paths and legs of vehicles that are on their way already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.planning.roads.arrays import Roads
from dispatcher_daemon.planning.roads.routes import RoadLeg, empty_leg
from dispatcher_daemon.planning.roads.travel import Travel, leg_along
from slipstream.energy.drive import DrivingStyle, plan_drive

_MIN_REST_M = 1.0
"""Of a segment that a vehicle has all but left; a drive needs a length."""


def leg_onward(
    travel: Travel,
    path: Sequence[str],
    start: tuple[str, str],
    end: tuple[str, str],
    style: DrivingStyle,
    *,
    complete: bool = False,
) -> RoadLeg | None:
    """The leg that begins with a path and goes on as is cheapest; None if no way leads there.

    Args:
        path: segments that it begins with; none: it begins at the start's junction.
        start: place and its junction.
        complete: whether the path is the whole leg.
    """
    if not path and start[1] == end[1]:
        return empty_leg(start[0], end[0])
    roads = travel.roads
    rows = [roads.index.get(name, -1) for name in path]
    if -1 in rows or any(pair not in roads.turn_number for pair in pairwise(rows)):
        return None
    if not complete:
        first = rows[-1:] or roads.leaving[start[1]]
        onward = _cheapest(travel, first, roads.entering[end[1]])
        if onward is None:
            return None
        rows = [*rows[:-1], *onward]
    return leg_along(roads, rows, start[0], end[0], style)


def leg_from(
    roads: Roads, leg: RoadLeg, share: float, speed_mps: float, style: DrivingStyle
) -> RoadLeg:
    """A leg as a vehicle drives it that is on its first segment.

    The part of that segment which lies behind it counts as driven at the planning speed, and needs
    no energy any more.

    Args:
        share: of the segment that lies behind it.
    """
    rows = np.array([roads.index[name] for name in leg.path])
    lengths = roads.length_m[rows].tolist()
    lengths[0] = max(_MIN_REST_M, (1.0 - share) * lengths[0])
    drive = plan_drive(lengths, roads.speed_mps[rows].tolist(), style, speed_mps)
    waiting = list(leg.drive.waiting_s or [0.0] * len(lengths))
    waiting[0] += unhindered_s(roads, leg.path[0], share)
    driven_m = float(roads.length_m[rows].sum())
    return replace(leg, drive=replace(drive.delayed(waiting), length_m=driven_m))


def unhindered_s(roads: Roads, segment: str, share: float) -> float:
    """Time for a share of a segment at its planning speed, s."""
    row = roads.index[segment]
    return float(share * roads.length_m[row] / roads.speed_mps[row])


def _cheapest(travel: Travel, first: Sequence[int], last: Sequence[int]) -> list[int] | None:
    """The cheapest path from one of some segments to one of others; None: there is none."""
    if not first or not last:
        return None
    distance, before = dijkstra(travel.turn_graph, indices=list(first), return_predecessors=True)
    whole = distance[:, list(last)] + travel.searched.finish[list(last)]
    whole = whole + travel.searched.begin[list(first)][:, None]
    origin, goal = divmod(int(np.argmin(whole)), len(last))
    if not np.isfinite(whole[origin, goal]):
        return None
    path = [int(last[goal])]
    while path[-1] != first[origin]:
        path.append(int(before[origin, path[-1]]))
    return path[::-1]
