"""Who follows closely, who opens the gap, who is on its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from simulation.controllers.platooning import road
from simulation.controllers.platooning.gap_control import (
    SLOWEST_MPS,
    Idm,
    close_gap_m,
    followed_gap_m,
    is_parted,
    parting_way_m,
)
from simulation.controllers.platooning.member import Contact
from simulation.controllers.platooning.rendezvous import FASTER, best_meeting
from simulation.controllers.platooning.snapshot import Scene
from slipstream.energy import ETA_FOLLOWER

_START_M: Final = 10.0
_JOINS_SPACINGS: Final = 2.0
_KEEPS_SPACINGS: Final = 3.0
_LANE_S: Final = 3.0
# SUMO sees nobody ahead for a step now and then, as where a lane begins.
_BLINK_S: Final = 1.0
_SETTLE_S: Final = 2.0


def disengage(scene: Scene, is_turbulent: Callable[[str], bool]) -> int:
    """Part platoons with a vehicle on a segment that is turbulent in truth behind an open gate.

    Returns:
        How many.
    """
    parted = 0
    for platoon in scene.platoons:
        on = (scene.states[name].segment for name in platoon)
        rough = next((s for s in on if is_turbulent(s) and scene.is_open(s)), None)
        if rough is None:
            continue
        parted += 1
        for name in platoon[1:]:
            scene.members[name].refused = rough
            scene.members[name].turn("parting", scene.now_s)
    return parted


def decide(scene: Scene, name: str) -> None:
    """Whether a vehicle follows closely, opens its gap or is on its own, from what is ahead."""
    member, contact = scene.members[name], scene.contacts.get(name)
    if contact is not None and contact.ahead in scene.members:
        keeps = member.mode == "following" and member.ahead == contact.ahead
        if _is_welcome(scene, name) and _pays(scene, name, contact, keeps=keeps):
            if member.mode == "alone":
                member.hurry = 1 + FASTER
                road.take_over(name, member.factor * member.hurry)
            if not keeps:
                member.turn("following", scene.now_s)
                member.ahead = contact.ahead
            _keep_lane(scene, name, contact.ahead)
            member.seen_s = scene.now_s
            return
    if member.mode == "following":
        if contact is None and scene.now_s - member.seen_s < _BLINK_S:
            return
        member.turn("parting", scene.now_s)
        _stay_behind(scene, name)
    if member.mode == "parting" and _is_apart(scene, name):
        road.hand_back(name, member.factor)
        member.turn("alone", scene.now_s)
        member.ahead, member.hurry = None, 1.0


def _is_welcome(scene: Scene, name: str) -> bool:
    """Whether the traffic that last parted it is behind it."""
    member = scene.members[name]
    if member.refused is not None:
        if member.refused in member.order.path[scene.states[name].number :]:
            return False
        member.refused = None
    return True


def _pays(scene: Scene, name: str, contact: Contact, *, keeps: bool) -> bool:
    """Whether gates are open for long enough."""
    way = scene.way(name, contact.ahead)
    run_m = 0.0 if way is None else way.open_run_m(scene.is_open)
    if run_m <= 0:
        return False
    speed_mps, followed_m = scene.states[name].speed_mps, followed_gap_m(scene.step_s)
    # From farther away the car-following model does better, with signals and others in between.
    if contact.gap_m > (_KEEPS_SPACINGS if keeps else _JOINS_SPACINGS) * _spacing_m(speed_mps):
        return False
    if keeps:
        return run_m > parting_way_m(speed_mps, contact.gap_m)
    cruise_mps = max(SLOWEST_MPS, scene.desired_mps(name))
    drafted_m = run_m - parting_way_m(cruise_mps, followed_m)
    if contact.gap_m <= close_gap_m(scene.step_s):
        return drafted_m > 0
    meeting = best_meeting(
        contact.gap_m - followed_m,
        cruise_mps,
        lambda way_m: max(0.0, drafted_m - way_m),
        ETA_FOLLOWER,
    )
    return meeting is not None


def _spacing_m(speed_mps: float) -> float:
    """Between vehicles alone at a speed, with some more for those that just start."""
    return _START_M + Idm().wanted_gap_m(speed_mps)


def _keep_lane(scene: Scene, name: str, ahead: str) -> None:
    """Have a follower stay on its leader's lane: it goes the same way, so it loses nothing."""
    member, own, other = scene.members[name], scene.states[name], scene.states[ahead]
    due = scene.now_s >= member.lane_until_s or own.lane != other.lane
    if due and own.segment == other.segment and not (own.crossing or other.crossing):
        member.lane_until_s = scene.now_s + _LANE_S
        road.to_lane(name, other.lane, _LANE_S + 1)


def _stay_behind(scene: Scene, name: str) -> None:
    """Follow a leader that has changed its lane."""
    ahead = scene.members[name].ahead
    if ahead is not None and ahead in scene.states:
        own, other = scene.states[name], scene.states[ahead]
        if own.lane != other.lane and own.front_m < other.front_m:
            _keep_lane(scene, name, ahead)


def _is_apart(scene: Scene, name: str) -> bool:
    if scene.now_s - scene.members[name].since_s < _SETTLE_S:
        return False
    contact = scene.contacts.get(name)
    return contact is None or is_parted(scene.motion(name), contact.ahead_mps)
