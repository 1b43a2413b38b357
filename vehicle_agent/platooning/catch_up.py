"""Catch-up: which vehicle ahead a vehicle alone wants to join, at which speeds, on which lane."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from slipstream.messages import PlatoonControl
from slipstream.spacing import MAX_SLOWDOWN
from vehicle_agent.platooning.gap_control import (
    IDM,
    MIN_SPEED_MPS,
    closing_mps,
)
from vehicle_agent.platooning.join_leave import is_planned_behind, too_long
from vehicle_agent.platooning.neighbours import SILENT_NS, Neighbours
from vehicle_agent.platooning.rendezvous import (
    MARGIN_KWH,
    Rendezvous,
    best_rendezvous,
)
from vehicle_agent.platooning.shared_path import (
    MAX_DISTANCE_M,
    SharedPath,
    find_shared_path,
    spacing_m,
)
from vehicle_agent.platooning.situation import Situation

SYNC_WINDOW_S: Final = 3.0
"""The dispatcher's: so far apart may those be that it plans as a platoon."""

DROP_BACK: Final = 0.05
"""Share of its speed that a vehicle beside another one takes off to come behind it."""

MOTORWAY_MPS: Final = 25.0
"""Limits above it are those of roads without signals, on which one overtakes."""

_FLOWING_SHARE: Final = 0.7
"""Of the limit; slower traffic is a queue, trucks drive at 0.8."""

_LANE_SPACINGS: Final = 2.0
"""As near as joining begins."""

_CLOSED_SHARE: Final = 0.02
"""Of the wanted gap; with less too much, the gap counts as closed."""


@dataclass(frozen=True, slots=True)
class CatchUp:
    """A rendezvous that a vehicle wants.

    Attributes:
        front: vehicle that it will follow.
        asked: front, or the leader of its platoon; None: that one is waiting for another vehicle.
        lane: wanted; None: any.
        drop_back: whether the vehicle is beside the other one, and must come behind it first.
    """

    front: PlatoonControl
    asked: str | None
    rendezvous: Rendezvous
    lane: int | None = None
    drop_back: bool = False


def find_catch_up(
    situation: Situation, vehicle: str, neighbours: Neighbours, behind: int
) -> CatchUp | None:
    """The rendezvous with a vehicle ahead on the same path, if it saves energy: with the next one
    of the plan's platoon while it is within the synchronisation window, else with the nearest one.

    Args:
        behind: number of the vehicle's followers, and of theirs.
    """
    s = situation
    # Near enough to join or to be refused.
    if s.partner is not None and s.gap_m <= 1.5 * IDM.desired_gap_m(s.state.speed_mps):
        return None
    found = _front(s, vehicle, neighbours, behind)
    if found is None:
        return None
    front, age_s, planned = found
    shared = find_shared_path(s.leg, s.state.number, s.place_m, front, age_s)
    if shared is None or _is_blocked(s, front, shared):
        return None
    rendezvous = _rendezvous(s, front, shared, leads=behind > 0, planned=planned)
    if rendezvous is None:
        return None
    asked = _free_to_ask(front, vehicle, neighbours)
    aside = _spacings_aside(s, front, shared)
    if aside is None or aside > _LANE_SPACINGS:
        return CatchUp(front, asked, rendezvous)
    # Nearer than one, it cannot change lanes; at equal speeds that would not change.
    return CatchUp(front, asked, rendezvous, front.lane if aside >= 1.0 else None, aside < 1.0)


def asked_of(front: PlatoonControl) -> str:
    """Who sets the speed of a vehicle's platoon."""
    return front.leader if front.mode == "following" else front.vehicle


def farthest_back(followers: Iterable[PlatoonControl]) -> str | None:
    """Follower with the largest gap."""
    told = [(one.gap_m, one.vehicle) for one in followers if one.gap_m is not None]
    return max(told)[1] if told else None


def closing_slowdown(situation: Situation, followers: Iterable[PlatoonControl]) -> float:
    """Share of its speed that a leader takes off so that its followers' open gaps close, who drive
    no faster than the limit.

    It is slow enough for all gaps together, and takes its speed up again no faster than they can
    slow down by coasting: see `closing_mps`.
    """
    own, lag_m = situation.own, 0.0
    for follower in followers:
        wanted_m = own.close_gap_m(follower.speed_mps)
        if follower.gap_m is not None and follower.gap_m > (1 + _CLOSED_SHARE) * wanted_m:
            lag_m += follower.gap_m - wanted_m
    return min(closing_mps(lag_m, own.coasting_mps2) / own.desired_mps, MAX_SLOWDOWN)


def _front(
    s: Situation, vehicle: str, neighbours: Neighbours, behind: int
) -> tuple[PlatoonControl, float, bool] | None:
    """Who may be joined, the age of its message, and whether the plan has it ahead. Nobody beyond
    it is asked while another one joins it, or its leader: to get there, all between would have to
    be overtaken.
    """
    followed = {h.message.ahead: h.message.vehicle for h in neighbours if h.message.ahead}
    best: tuple[tuple[bool, int, float], PlatoonControl, float] | None = None
    for heard in neighbours:
        front, age_ns = heard.message, heard.age_ns(s.now_ns)
        if age_ns is None or age_ns > SILENT_NS or vehicle in (front.ahead, front.leader):
            continue
        if followed.get(front.vehicle, vehicle) != vehicle:
            continue
        away_m = spacing_m(s.leg, s.state.number, s.place_m, front, age_ns / 1e9)
        if away_m > MAX_DISTANCE_M or too_long(s, front, neighbours, behind) is not None:
            continue
        window_m = SYNC_WINDOW_S * s.own.desired_mps + front.length_m
        planned = away_m <= window_m and is_planned_behind(s, front)
        rank = not planned, -(front.place or 0) if planned else 0, away_m
        if best is None or rank < best[0]:
            best = rank, front, age_ns / 1e9
    return None if best is None else (best[1], best[2], not best[0][0])


def _free_to_ask(front: PlatoonControl, vehicle: str, neighbours: Neighbours) -> str | None:
    """Who sets the speed of a vehicle's platoon, unless it waits for another one."""
    asked = asked_of(front)
    leader = neighbours.get(asked) or front
    return asked if {front.joined_by, leader.joined_by} <= {None, vehicle} else None


def _rendezvous(
    s: Situation, front: PlatoonControl, shared: SharedPath, *, leads: bool, planned: bool
) -> Rendezvous | None:
    if not _is_worth_speed(s, shared):
        return None
    own = s.own
    speed_mps = max(MIN_SPEED_MPS, min(own.desired_mps, front.desired_mps))
    etas = own.reductions(speed_mps)
    # A platoon that has followers already gets one more between its leader and its last vehicle.
    added = etas.middle if front.mode == "following" else etas.follower
    added -= etas.leader if leads else 0.0
    if front.mode != "following":
        added += etas.leader
    wanted_m = own.close_gap_m(speed_mps)
    return best_rendezvous(
        max(0.0, shared.spacing_m - front.length_m - wanted_m),
        speed_mps,
        lambda begin_m: shared.open_beyond_m(begin_m, s.gates.is_open),
        added,
        max_speedup=s.max_speedup,
        vehicle=own.vehicle,
        margin_kwh=0.0 if planned else MARGIN_KWH,
    )


def _is_worth_speed(s: Situation, shared: SharedPath) -> bool:
    """Whether a speed that is gained here lasts to where the gates are open; on a ramp or a side
    street it does not: vehicles slow down to turn at its end.
    """
    for i, (segment, _) in enumerate(shared.parts):
        if s.gates.is_open(segment):
            return i == 0 or s.limit_mps >= s.leg.limits_mps[s.state.number + i]
    return False


def _is_blocked(s: Situation, front: PlatoonControl, shared: SharedPath) -> bool:
    """Whether a vehicle between the two blocks the rear one, which could only brake behind it; on a
    motorway with free lanes it overtakes.
    """
    if s.ahead is None or s.ahead.vehicle == front.vehicle or _can_pass(s):
        return False
    return s.gap_m < shared.spacing_m


def _can_pass(s: Situation) -> bool:
    """Whether there is another lane of a road for overtaking, and no queue on it."""
    flows = s.state.speed_mps > _FLOWING_SHARE * s.limit_mps
    return s.limit_mps > MOTORWAY_MPS and flows and (s.planned.lanes or 1) > 1


def _spacings_aside(s: Situation, front: PlatoonControl, shared: SharedPath) -> float | None:
    """Distance to a vehicle on another lane of the same segment, in car-following gaps; None where
    it is on none, or where neither a plan has it behind that one nor overtaking is possible.
    """
    crossing = s.state.crossing or front.crossing
    if shared.meets > 0 or crossing or s.state.lane == front.lane:
        return None
    if not (is_planned_behind(s, front) or _can_pass(s)):
        return None
    return (shared.spacing_m - front.length_m) / IDM.desired_gap_m(s.state.speed_mps)
