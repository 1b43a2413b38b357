"""Join and leave: transitions between driving alone, following and leaving."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import simulation.controllers.platooning.road as road
from simulation.controllers.platooning.gap_control import (
    MIN_SPEED_MPS,
    Idm,
    close_gap_m,
    followed_gap_m,
    has_left,
    leaving_distance_m,
)
from simulation.controllers.platooning.member import Contact
from simulation.controllers.platooning.rendezvous import MAX_SPEEDUP, best_rendezvous
from simulation.controllers.platooning.snapshot import FleetSnapshot
from slipstream.energy import ETA_FOLLOWER

_START_M: Final = 10.0
_JOIN_SPACINGS: Final = 2.0
_KEEP_SPACINGS: Final = 3.0
_LANE_S: Final = 3.0
# SUMO reports no vehicle ahead in single steps, as where a lane begins.
_DROPOUT_S: Final = 1.0
_SETTLE_S: Final = 2.0


def disengage(snapshot: FleetSnapshot, is_turbulent: Callable[[str], bool]) -> int:
    """Disengage platoons on segments with an open gate whose true traffic is turbulent.

    Returns:
        Number of platoons.
    """
    parted = 0
    for platoon in snapshot.platoons:
        on = (snapshot.states[name].segment for name in platoon)
        rough = next((s for s in on if is_turbulent(s) and snapshot.is_open(s)), None)
        if rough is None:
            continue
        parted += 1
        for name in platoon[1:]:
            snapshot.members[name].disengaged_on = rough
            snapshot.members[name].set_mode("leaving", snapshot.now_s)
    return parted


def decide(snapshot: FleetSnapshot, name: str) -> None:
    """Set a vehicle's mode by the vehicle ahead and the gates."""
    member, contact = snapshot.members[name], snapshot.contacts.get(name)
    if contact is not None and contact.ahead in snapshot.members:
        keeps = member.mode == "following" and member.ahead == contact.ahead
        if _may_join(snapshot, name) and _is_worthwhile(snapshot, name, contact, keeps=keeps):
            if member.mode == "alone":
                member.speed_scale = 1 + MAX_SPEEDUP
                road.start_control(name, member.factor * member.speed_scale)
            if not keeps:
                member.set_mode("following", snapshot.now_s)
                member.ahead = contact.ahead
            _keep_lane(snapshot, name, contact.ahead)
            member.seen_s = snapshot.now_s
            return
    if member.mode == "following":
        if contact is None and snapshot.now_s - member.seen_s < _DROPOUT_S:
            return
        member.set_mode("leaving", snapshot.now_s)
        _stay_behind(snapshot, name)
    if member.mode == "leaving" and _has_left(snapshot, name):
        road.end_control(name, member.factor)
        member.set_mode("alone", snapshot.now_s)
        member.ahead, member.speed_scale = None, 1.0


def _may_join(snapshot: FleetSnapshot, name: str) -> bool:
    """Whether it has left the segment of its last disengagement."""
    member = snapshot.members[name]
    if member.disengaged_on is not None:
        if member.disengaged_on in member.order.path[snapshot.states[name].number :]:
            return False
        member.disengaged_on = None
    return True


def _is_worthwhile(snapshot: FleetSnapshot, name: str, contact: Contact, *, keeps: bool) -> bool:
    """Whether the open distance ahead pays for joining, or for staying."""
    shared_path = snapshot.shared_path(name, contact.ahead)
    run_m = 0.0 if shared_path is None else shared_path.open_distance_m(snapshot.is_open)
    if run_m <= 0:
        return False
    speed_mps, followed_m = snapshot.states[name].speed_mps, followed_gap_m(snapshot.step_s)
    # From farther away the car-following model does better, with signals and others in between.
    if contact.gap_m > (_KEEP_SPACINGS if keeps else _JOIN_SPACINGS) * _spacing_m(speed_mps):
        return False
    if keeps:
        return run_m > leaving_distance_m(speed_mps, contact.gap_m)
    cruise_mps = max(MIN_SPEED_MPS, snapshot.desired_mps(name))
    drafted_m = run_m - leaving_distance_m(cruise_mps, followed_m)
    if contact.gap_m <= close_gap_m(snapshot.step_s):
        return drafted_m > 0
    rendezvous = best_rendezvous(
        contact.gap_m - followed_m,
        cruise_mps,
        lambda way_m: max(0.0, drafted_m - way_m),
        ETA_FOLLOWER,
    )
    return rendezvous is not None


def _spacing_m(speed_mps: float) -> float:
    """Car-following gap at a speed, plus a margin for vehicles that just start."""
    return _START_M + Idm().desired_gap_m(speed_mps)


def _keep_lane(snapshot: FleetSnapshot, name: str, ahead: str) -> None:
    """Keep a follower on its leader's lane; both drive the same path."""
    member, own, other = snapshot.members[name], snapshot.states[name], snapshot.states[ahead]
    due = snapshot.now_s >= member.lane_until_s or own.lane != other.lane
    if due and own.segment == other.segment and not (own.crossing or other.crossing):
        member.lane_until_s = snapshot.now_s + _LANE_S
        road.change_lane(name, other.lane, _LANE_S + 1)


def _stay_behind(snapshot: FleetSnapshot, name: str) -> None:
    """Change to the lane of a leader that has changed its own."""
    ahead = snapshot.members[name].ahead
    if ahead is not None and ahead in snapshot.states:
        own, other = snapshot.states[name], snapshot.states[ahead]
        if own.lane != other.lane and own.front_m < other.front_m:
            _keep_lane(snapshot, name, ahead)


def _has_left(snapshot: FleetSnapshot, name: str) -> bool:
    if snapshot.now_s - snapshot.members[name].since_s < _SETTLE_S:
        return False
    contact = snapshot.contacts.get(name)
    return contact is None or has_left(snapshot.motion(name), contact.ahead_mps)
