"""Paths and legs of vehicles that are on their way already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from dispatcher_daemon.roads.routes import Leg, empty_leg
from dispatcher_daemon.roads.travel import Roads, leg_along
from dispatcher_daemon.roads.weights import Weights
from slipstream.drive import DrivingStyle, plan_drive

_MIN_REST_M = 1.0
"""Of a segment that a vehicle has all but left; a drive needs a length."""


def leg_onward(
    roads: Roads,
    searched: Weights,
    path: Sequence[str],
    start: tuple[str, str],
    end: tuple[str, str],
    style: DrivingStyle,
) -> Leg | None:
    """The leg that begins with a path and goes on as is cheapest; None if no way leads there.

    Args:
        roads: of the cycle.
        searched: costs to minimise.
        path: segments that it begins with; none: it begins at the start's junction.
        start: place and its junction.
        end: likewise.
        style: of the drive.
    """
    if not path and start[1] == end[1]:
        return empty_leg(start[0], end[0])
    rows = [roads.index[name] for name in path]
    first = rows[-1:] or roads.leaving[start[1]]
    onward = _cheapest(roads, searched, first, roads.entering[end[1]])
    if onward is None:
        return None
    return leg_along(roads, [*rows[:-1], *onward], start[0], end[0], style)


def leg_from(roads: Roads, leg: Leg, share: float, speed_mps: float, style: DrivingStyle) -> Leg:
    """A leg as a vehicle drives it that is on its first segment.

    The part of that segment which lies behind it counts as driven at the planning speed, and needs
    no energy any more.

    Args:
        roads: of the cycle.
        leg: from the begin of the segment.
        share: of the segment that lies behind it.
        speed_mps: at which it drives.
        style: of the drive.
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


def _cheapest(
    roads: Roads, searched: Weights, first: Sequence[int], last: Sequence[int]
) -> list[int] | None:
    """The cheapest path from one of some segments to one of others; None: there is none."""
    if not first or not last:
        return None
    m = len(roads.ids)
    onto = np.concatenate([roads.turn[1], np.array(first, dtype=np.int64)])
    origin = np.concatenate([roads.turn[0], np.full(len(first), m)])
    cost = np.concatenate([searched.turn, searched.begin[list(first)]])
    graph = csr_array((cost, (origin, onto)), shape=(m + 1, m + 1))
    distance, before = dijkstra(graph, indices=m, return_predecessors=True)
    whole = distance[list(last)] + searched.finish[list(last)]
    best = int(np.argmin(whole))
    if not np.isfinite(whole[best]):
        return None
    path = [int(last[best])]
    while before[path[-1]] != m:
        path.append(int(before[path[-1]]))
    return path[::-1]
