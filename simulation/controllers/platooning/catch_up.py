"""Who hurries to catch up with whom, and who waits for it."""

from __future__ import annotations

from typing import Final

from simulation.controllers.platooning import road
from simulation.controllers.platooning.gap_control import (
    SLOWEST_MPS,
    Idm,
    close_gap_m,
    followed_gap_m,
)
from simulation.controllers.platooning.rendezvous import SLOWER, Meeting, best_meeting
from simulation.controllers.platooning.shared_path import SharedWay
from simulation.controllers.platooning.snapshot import Scene
from slipstream.energy import ETA_FOLLOWER, ETA_LEADER

_MOTORWAY_MPS: Final = 25.0
"""Limits above it are those of roads without signals, on which one overtakes."""

_FLOWS: Final = 0.7
"""Of the limit; slower traffic is a queue, trucks drive at 0.8."""

_DROPS_BACK: Final = SLOWER / 2
_LANE_SPACINGS: Final = 2.0
"""As near as joining begins."""

_LANE_S: Final = 3.0
"""Longer than the two seconds between two looks."""


def bring_together(scene: Scene) -> None:
    """Choose meetings, and what both sides gain and yield; one at most catches up with each."""
    members = scene.members
    for member in members.values():
        member.gains = member.yields = 0.0
    behind = {m.ahead: name for name, m in members.items() if m.mode == "following"}
    taken: set[str] = set()
    for rear, member in members.items():
        if member.refused is not None or _is_there(scene, rear):
            continue
        found = _meeting(scene, rear, behind, taken)
        if found is None:
            continue
        front, meeting = found
        if _is_blocked(scene, rear, front):
            continue
        taken.add(front)
        aside = _spacings_aside(scene, rear, front) if member.mode == "alone" else None
        if aside is not None and aside < 1.0:
            # Too near to change lanes; at the same speed they would stay so for good.
            member.yields = max(member.yields, _DROPS_BACK)
            continue
        if aside is not None and aside <= _LANE_SPACINGS:
            _to_one_lane(scene, rear, front)
        member.gains = meeting.faster
        leader = _leader(scene, front)
        members[leader].yields = max(members[leader].yields, meeting.slower)


def _is_there(scene: Scene, name: str) -> bool:
    """Whether a vehicle is as near to another one as it may be.

    Alone behind a closed gate that is where its car-following model would hold it: whoever hurries
    there overtakes.
    """
    member, contact = scene.members[name], scene.contacts.get(name)
    if member.mode == "parting":
        return True
    if contact is None or contact.ahead not in scene.members:
        return False
    if member.mode == "following":
        return contact.gap_m <= close_gap_m(scene.step_s)
    return contact.gap_m <= 1.5 * Idm().wanted_gap_m(scene.states[name].speed_mps)


def _is_worth_speed(scene: Scene, way: SharedWay) -> bool:
    """Whether a speed that is gained here lasts to where the gates are open.

    From a ramp or a side street it does not: at its end everybody slows down to turn.
    """
    here = way.parts[0][0]
    first = next((segment for segment, _ in way.parts if scene.is_open(segment)), None)
    if first is None:
        return False
    return first == here or scene.limit_mps(here) >= scene.limit_mps(first)


def _is_blocked(scene: Scene, rear: str, front: str) -> bool:
    """Whether others drive between whom one cannot overtake: hurrying up to them wins nothing but
    braking. On a motorway the one who hurries passes them.
    """
    if _can_pass(scene, rear):
        return False
    contact = scene.contacts.get(rear)
    ahead = road.ahead(rear) if contact is None else (contact.ahead, contact.gap_m)
    return ahead is not None and ahead[0] != front


def _can_pass(scene: Scene, name: str) -> bool:
    """Whether there is another lane of a road for overtaking, and no queue on it."""
    state = scene.states[name]
    limit_mps = scene.limit_mps(state.segment)
    flows = state.speed_mps > _FLOWS * limit_mps
    return limit_mps > _MOTORWAY_MPS and flows and road.lanes(state.segment) > 1


def _spacings_aside(scene: Scene, rear: str, front: str) -> float | None:
    """How many car-following gaps a vehicle on another lane of the same segment is ahead, where
    overtaking goes; None: it is not on one.
    """
    own, other = scene.states[rear], scene.states[front]
    if own.segment != other.segment or own.lane == other.lane or own.crossing or other.crossing:
        return None
    if not _can_pass(scene, rear):
        return None
    gap_m = other.front_m - road.length_m(front) - own.front_m
    return gap_m / Idm().wanted_gap_m(own.speed_mps)


def _to_one_lane(scene: Scene, rear: str, front: str) -> None:
    """Send the rear one to the front one's lane, or that one to its lane if somebody else is behind
    it; SUMO changes as soon as that is safe.
    """
    own, other = scene.states[rear], scene.states[front]
    between = road.behind(front, other.front_m - own.front_m)
    if between is None or between == rear:
        mover, lane = rear, other.lane
    else:
        mover, lane = front, own.lane
    if scene.members[mover].mode == "alone" and road.leads_on(mover, lane):
        road.to_lane(mover, lane, _LANE_S)


def _leader(scene: Scene, name: str) -> str:
    """Who sets the pace of a vehicle: itself, or the front of those that follow each other."""
    seen = {name}
    while scene.members[name].mode == "following":
        ahead = scene.members[name].ahead
        if ahead is None or ahead not in scene.members or ahead in seen:
            break
        name = ahead
        seen.add(name)
    return name


def _meeting(
    scene: Scene, rear: str, behind: dict[str | None, str], taken: set[str]
) -> tuple[str, Meeting] | None:
    """With the nearest vehicle ahead on the same way, if it pays."""
    nearest: tuple[float, str, SharedWay] | None = None
    for front in scene.members:
        if front == rear or front in taken or behind.get(front, rear) != rear:
            continue
        way = scene.way(rear, front)
        if way is not None and (nearest is None or way.between_m < nearest[0]):
            nearest = way.between_m, front, way
    if nearest is None:
        return None
    between_m, front, way = nearest
    if not _is_worth_speed(scene, way):
        return None
    added = ETA_FOLLOWER - (ETA_LEADER if rear in behind else 0.0)
    if scene.members[front].mode != "following":
        added += ETA_LEADER
    meeting = best_meeting(
        max(0.0, between_m - road.length_m(front) - followed_gap_m(scene.step_s)),
        max(SLOWEST_MPS, min(scene.desired_mps(rear), scene.desired_mps(front))),
        lambda begin_m: way.open_beyond_m(begin_m, scene.is_open),
        added,
    )
    return None if meeting is None else (front, meeting)
