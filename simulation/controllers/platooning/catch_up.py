"""Catch-up: which vehicle drives faster towards which, and which one slows down for it."""

from __future__ import annotations

from typing import Final

import simulation.controllers.platooning.road as road
from simulation.controllers.platooning.gap_control import (
    MIN_SPEED_MPS,
    Idm,
    close_gap_m,
    followed_gap_m,
)
from simulation.controllers.platooning.rendezvous import MAX_SLOWDOWN, Rendezvous, best_rendezvous
from simulation.controllers.platooning.shared_path import SharedPath
from simulation.controllers.platooning.snapshot import FleetSnapshot
from slipstream.energy import ETA_FOLLOWER, ETA_LEADER

_MOTORWAY_MPS: Final = 25.0
"""Limits above it are those of roads without signals, on which one overtakes."""

_FLOWING_SHARE: Final = 0.7
"""Of the limit; slower traffic is a queue, trucks drive at 0.8."""

_DROP_BACK: Final = MAX_SLOWDOWN / 2
_LANE_SPACINGS: Final = 2.0
"""As near as joining begins."""

_LANE_S: Final = 3.0
"""Longer than the two seconds between two looks."""


def assign_catch_ups(snapshot: FleetSnapshot) -> None:
    """Choose rendezvous and set both vehicles' speed changes; at most one catches up with each."""
    members = snapshot.members
    for member in members.values():
        member.speedup = member.slowdown = 0.0
    behind = {m.ahead: name for name, m in members.items() if m.mode == "following"}
    taken: set[str] = set()
    for rear, member in members.items():
        if member.disengaged_on is not None or _has_arrived(snapshot, rear):
            continue
        found = _best_rendezvous(snapshot, rear, behind, taken)
        if found is None:
            continue
        front, rendezvous = found
        if _is_blocked(snapshot, rear, front):
            continue
        taken.add(front)
        aside = _spacings_aside(snapshot, rear, front) if member.mode == "alone" else None
        if aside is not None and aside < 1.0:
            # Too near to change lanes; at equal speeds that would not change.
            member.slowdown = max(member.slowdown, _DROP_BACK)
            continue
        if aside is not None and aside <= _LANE_SPACINGS:
            _to_same_lane(snapshot, rear, front)
        member.speedup = rendezvous.speedup
        leader = _leader(snapshot, front)
        members[leader].slowdown = max(members[leader].slowdown, rendezvous.slowdown)


def _has_arrived(snapshot: FleetSnapshot, name: str) -> bool:
    """Whether a vehicle is as close to the one ahead as it may be.

    For a vehicle alone, that is the distance of its car-following model; a faster one would
    overtake there.
    """
    member, contact = snapshot.members[name], snapshot.contacts.get(name)
    if member.mode == "leaving":
        return True
    if contact is None or contact.ahead not in snapshot.members:
        return False
    if member.mode == "following":
        return contact.gap_m <= close_gap_m(snapshot.step_s)
    return contact.gap_m <= 1.5 * Idm().desired_gap_m(snapshot.states[name].speed_mps)


def _is_worth_speed(snapshot: FleetSnapshot, shared_path: SharedPath) -> bool:
    """Whether a speed that is gained here lasts to where the gates are open.

    On a ramp or a side street it does not: vehicles slow down to turn at its end.
    """
    here = shared_path.parts[0][0]
    first = next((segment for segment, _ in shared_path.parts if snapshot.is_open(segment)), None)
    if first is None:
        return False
    return first == here or snapshot.limit_mps(here) >= snapshot.limit_mps(first)


def _is_blocked(snapshot: FleetSnapshot, rear: str, front: str) -> bool:
    """Whether vehicles between the two block the rear one, which could only brake behind them.

    On a motorway with free lanes it overtakes them.
    """
    if _can_pass(snapshot, rear):
        return False
    contact = snapshot.contacts.get(rear)
    ahead = road.ahead(rear) if contact is None else (contact.ahead, contact.gap_m)
    return ahead is not None and ahead[0] != front


def _can_pass(snapshot: FleetSnapshot, name: str) -> bool:
    """Whether there is another lane of a road for overtaking, and no queue on it."""
    state = snapshot.states[name]
    limit_mps = snapshot.limit_mps(state.segment)
    flows = state.speed_mps > _FLOWING_SHARE * limit_mps
    return limit_mps > _MOTORWAY_MPS and flows and road.lanes(state.segment) > 1


def _spacings_aside(snapshot: FleetSnapshot, rear: str, front: str) -> float | None:
    """Distance to a vehicle on another lane of the same segment, in car-following gaps.

    None where it is not on another lane, or overtaking is not possible.
    """
    own, other = snapshot.states[rear], snapshot.states[front]
    if own.segment != other.segment or own.lane == other.lane or own.crossing or other.crossing:
        return None
    if not _can_pass(snapshot, rear):
        return None
    gap_m = other.front_m - road.length_m(front) - own.front_m
    return gap_m / Idm().desired_gap_m(own.speed_mps)


def _to_same_lane(snapshot: FleetSnapshot, rear: str, front: str) -> None:
    """Have the rear vehicle change to the front one's lane, or the reverse if another vehicle is
    between them. SUMO changes lanes as soon as it is safe.
    """
    own, other = snapshot.states[rear], snapshot.states[front]
    between = road.behind(front, other.front_m - own.front_m)
    if between is None or between == rear:
        mover, lane = rear, other.lane
    else:
        mover, lane = front, own.lane
    if snapshot.members[mover].mode == "alone" and road.lane_continues(mover, lane):
        road.change_lane(mover, lane, _LANE_S)


def _leader(snapshot: FleetSnapshot, name: str) -> str:
    """The leader of a vehicle's platoon; itself where it follows none."""
    seen = {name}
    while snapshot.members[name].mode == "following":
        ahead = snapshot.members[name].ahead
        if ahead is None or ahead not in snapshot.members or ahead in seen:
            break
        name = ahead
        seen.add(name)
    return name


def _best_rendezvous(
    snapshot: FleetSnapshot, rear: str, behind: dict[str | None, str], taken: set[str]
) -> tuple[str, Rendezvous] | None:
    """The rendezvous with the nearest vehicle ahead on the same path, if it saves energy."""
    nearest: tuple[float, str, SharedPath] | None = None
    for front in snapshot.members:
        if front == rear or front in taken or behind.get(front, rear) != rear:
            continue
        shared_path = snapshot.shared_path(rear, front)
        if shared_path is not None and (nearest is None or shared_path.spacing_m < nearest[0]):
            nearest = shared_path.spacing_m, front, shared_path
    if nearest is None:
        return None
    spacing_m, front, shared_path = nearest
    if not _is_worth_speed(snapshot, shared_path):
        return None
    added = ETA_FOLLOWER - (ETA_LEADER if rear in behind else 0.0)
    if snapshot.members[front].mode != "following":
        added += ETA_LEADER
    rendezvous = best_rendezvous(
        max(0.0, spacing_m - road.length_m(front) - followed_gap_m(snapshot.step_s)),
        max(MIN_SPEED_MPS, min(snapshot.desired_mps(rear), snapshot.desired_mps(front))),
        lambda begin_m: shared_path.open_beyond_m(begin_m, snapshot.is_open),
        added,
    )
    return None if rendezvous is None else (front, rendezvous)
