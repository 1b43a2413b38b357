"""The coming interval's acceleration and speed: commanded while a vehicle follows, leaves or leads,
else its set speed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

from slipstream.messages import PlatoonControl, PlatoonMode
from slipstream.spacing import CLOSE_GAP_M, RESPONSE_S, closing_m, reaction_s
from vehicle_agent.platooning.agreement import Joining
from vehicle_agent.platooning.gap_control import (
    COMFORTABLE_MPS2,
    IDM,
    SOFT_MPS2,
    Own,
    following_mps2,
    leaving_mps2,
    waiting_mps,
)
from vehicle_agent.platooning.needed_braking import AIM_M, AheadMotion, needed_mps2
from vehicle_agent.platooning.situation import Situation, allowed_mps

_OBEYED_MPS: Final = 0.05
_FASTER_MPS: Final = 0.35
_LED_MPS: Final = 0.15
_FEED_MPS2: Final = 0.1
_NEAR_M: Final = 0.12
_NEEDED_MPS2: Final = 0.5
"""Smaller decelerations are left to the gap control."""

_EARLY_SHARE: Final = 1.2
"""Of the needed braking: a leader, which drives later than it commands, brakes the earlier."""

_BROKEN_SHARE: Final = 1.3
"""Of a promise: a leader that needs more than that breaks it, and at once. It does not come to that
while the traffic ahead brakes as it can, but after a cut-in it may.
"""

_ROOM_SHARE: Final = 1.1
"""Of the gap that a leader needs, which it keeps: it coasts before its promise has to end."""

DELAY_S: Final = 0.3
"""Between what a leader tells and what it drives: three messages may be lost in a row."""


class Command(NamedTuple):
    """Of the coming interval: its acceleration, and the speed at its end."""

    mps2: float
    mps: float


def commanded(
    situation: Situation,
    mode: PlatoonMode,
    front: PlatoonControl | None,
    cap_mps: float,
    limit_mps2: float | None,
) -> Command | None:
    """What a follower, or a vehicle that leaves, is commanded, within `cap_mps` of the rest of the
    agent; None while it drives alone.

    At most the limit here. It brakes no harder than it has promised (`limit_mps2`), unless more is
    needed for the vehicle ahead, and then as hard as it can at most.

    While no vehicle is sensed ahead, it drives no faster than `front`, which it follows, told.
    Where that one has told of another lane it is not in the way, and coasting is enough.
    """
    if mode == "alone":
        return None
    s, own, ahead = situation, situation.own, situation.motion
    if not s.sensing_in_time:  # blind, it goes by what it hears, and else brakes comfortably
        if ahead is None or s.partner is None:
            return _command(s, -own.comfortable_mps2)
        return _command(s, min(0.0, ahead.feed_mps2) - SOFT_MPS2)
    if ahead is None:
        a = 0.0
        if front is not None and front.announced_mps < own.speed_mps:
            a = (front.announced_mps - own.speed_mps) * own.gain_per_s
            if on_another_lane(situation, front):
                a = max(a, -own.coasting_mps2)
    else:
        law = following_mps2 if mode == "following" else leaving_mps2
        a = law(own, believed(own, ahead, s.wanted_m), s.wanted_m)
    a = min(a, _bounded_mps2(s, cap_mps, limit_mps2), _coasted_mps2(own, cap_mps))
    if limit_mps2 is not None:
        a = max(a, -own.braking.commanded_mps2(limit_mps2))
    if ahead is not None:
        needed = needed_mps2(ahead, own.speed_mps, own.then_mps, own.braking.response_s)
        if needed > max(_least_needed_mps2(ahead, limit_mps2), -a):
            a = -needed
        if ahead.gap_m < AIM_M and own.speed_mps >= ahead.speed_mps:
            a = min(a, -ahead.slowing_mps2 - COMFORTABLE_MPS2)
    return _command(s, a)


def believed(own: Own, ahead: AheadMotion, wanted_m: float) -> AheadMotion:
    """The vehicle ahead without what is told of speeding up, where the own one is about as near as
    wanted and faster than that one is sensed to be, or nearer than noise explains.
    """
    told_mps = ahead.speed_mps if ahead.leader_mps is None else ahead.leader_mps
    leads = told_mps > ahead.speed_mps + _LED_MPS and ahead.feed_mps2 > -_LED_MPS
    if not leads and ahead.feed_mps2 <= _FEED_MPS2:
        return ahead
    faster = own.speed_mps > ahead.speed_mps + _FASTER_MPS
    nearer = own.speed_mps >= ahead.speed_mps and ahead.gap_m < wanted_m - _NEAR_M
    nearer = nearer and wanted_m <= CLOSE_GAP_M
    if not nearer and not (faster and ahead.gap_m < wanted_m + _NEAR_M):
        return ahead
    leader = ahead.leader_mps
    return replace(
        ahead,
        feed_mps2=min(0.0, ahead.feed_mps2),
        leader_mps=None if leader is None else min(leader, ahead.speed_mps),
    )


def _least_needed_mps2(ahead: AheadMotion, limit_mps2: float | None) -> float:
    """From which needed deceleration on the gap control is overruled: early where the vehicle ahead
    brakes, and where the own brake is limited.
    """
    if ahead.slowing_mps2 > 0:
        return _NEEDED_MPS2
    return COMFORTABLE_MPS2 if limit_mps2 is None else min(COMFORTABLE_MPS2, limit_mps2 / 2)


def _bounded_mps2(s: Situation, cap_mps: float, limit_mps2: float | None) -> float:
    """The largest acceleration that keeps limits, places ahead and a cap."""
    own, braking = s.own, COMFORTABLE_MPS2
    if limit_mps2 is not None:
        braking = min(braking, own.braking.commanded_mps2(limit_mps2))
    if own.braking.nominal_s <= 0:
        bound = min(allowed_mps(s, own.interval_s, braking), cap_mps)
        return (bound - own.speed_mps) / own.interval_s
    bound = allowed_mps(s, own.interval_s + own.braking.response_s + 1 / own.gain_per_s, braking)
    return own.gain_per_s * (min(bound, cap_mps) - own.then_mps)


def _coasted_mps2(own: Own, cap_mps: float) -> float:
    """What a cap below the own speed asks for, as far as coasting does it. The speed loop alone
    would take it for done already, by what is under way in brake and drive, and never coast.
    """
    asked = (cap_mps - own.speed_mps) / own.interval_s
    return max(asked, -own.coasting_mps2) if asked < 0 else math.inf


def _command(s: Situation, a: float) -> Command:
    own = s.own
    mps = min(max(own.speed_mps + a * own.interval_s, s.lowest_mps), s.limit_mps)
    return Command(max(a, -own.braking.guaranteed_mps2), max(0.0, mps))


def on_another_lane(situation: Situation, front: PlatoonControl) -> bool:
    """Whether a vehicle has told of another lane of the same segment."""
    state = situation.state
    same = front.path[0] == state.segment and not (front.crossing or state.crossing)
    return same and front.lane != state.lane


def leading(
    situation: Situation,
    planned_mps2: tuple[float, ...],
    set_mps: float,
    cap_mps: float,
    limit_mps2: float | None,
) -> tuple[float, ...]:
    """Accelerations of a leader for the coming intervals, m/s²: those that it has told, and one
    more. Behind others it keeps the gap of a driver alone, or what a leader needs. A lower set
    speed it reaches by coasting.

    Args:
        planned_mps2: that it has told for the coming intervals, the next one first.
        limit_mps2: that it has promised its follower; None: nothing, so that it waits with nothing.
    """
    own = situation.own
    count = 0 if limit_mps2 is None else int(DELAY_S / own.interval_s + 1e-6)
    told = (*planned_mps2, *[0.0] * count)[:count]
    later_s = count * own.interval_s
    s = _later(situation, sum(told) * own.interval_s, later_s) if told else situation
    own, ahead = s.own, s.motion
    a = own.gain_per_s * (set_mps - own.then_mps)
    a = max(-0.9 * own.coasting_mps2, min(a, IDM.acceleration_mps2))
    if ahead is not None:
        a = min(a, IDM.acceleration_to_mps2(own, ahead.gap_m, ahead.speed_mps))
        if limit_mps2 is not None and ahead.gap_m < _ROOM_SHARE * leading_gap_m(s, limit_mps2):
            a = min(a, -own.coasting_mps2)
    coasted = _coasted_mps2(situation.own, cap_mps)
    a, needed = min(a, _bounded_mps2(s, cap_mps, limit_mps2), coasted), 0.0
    if ahead is not None:
        needed = needed_mps2(ahead, own.speed_mps, own.then_mps, own.braking.response_s)
        if needed > _least_needed_mps2(ahead, limit_mps2):
            a = min(a, -_EARLY_SHARE * needed)
    if limit_mps2 is not None:
        if needed > _BROKEN_SHARE * limit_mps2 and ahead is not None:
            at_least = (own.speed_mps, own.then_mps, own.braking.response_s, 0.0)
            if needed_mps2(ahead, *at_least) > _BROKEN_SHARE * limit_mps2:
                return (max(-needed, -own.braking.guaranteed_mps2),) * (count + 1)
        capped = own.gain_per_s * (cap_mps - own.then_mps)  # a stop line may ask for more
        least = min(-own.braking.commanded_mps2(limit_mps2), max(capped, -COMFORTABLE_MPS2))
        a = max(a, least)
    return (*told, max(a, -own.braking.guaranteed_mps2))


def leading_gap_m(s: Situation, limit_mps2: float) -> float:
    """Gap to the traffic ahead that a leader needs which brakes no harder than it promised, m: the
    traffic brakes as hard as it can, and the leader drives on for what it has told before.
    """
    if s.motion is None:
        return 0.0
    own = s.own
    rear_mps2 = own.braking.commanded_mps2(limit_mps2) * (1 - own.braking.error)
    wait_s = DELAY_S if own.interval_s <= RESPONSE_S else 0.0
    rho_s = reaction_s(own.braking, own.interval_s) + wait_s
    return AIM_M + closing_m(
        s.motion.speed_mps, own.speed_mps, s.motion.bound_mps2, rear_mps2, rho_s
    )


def held_back(s: Situation, limit_mps2: float | None) -> float:
    """Share of its speed by which a leader is slower than the traffic ahead, to get as far behind
    it as its promise asks for.
    """
    own, motion = s.own, s.motion
    if limit_mps2 is None or motion is None:
        return 0.0
    room_m = _ROOM_SHARE * leading_gap_m(s, limit_mps2)
    near = IDM.desired_gap_m(own.speed_mps) < motion.gap_m < room_m
    slower_mps = min(motion.speed_mps, own.desired_mps) - own.speed_mps
    return max(0.0, slower_mps / own.desired_mps) if near else 0.0


def command_of(situation: Situation, planned_mps2: tuple[float, ...]) -> Command:
    """What a leader is commanded of its plan."""
    return _command(situation, planned_mps2[0])


def _later(s: Situation, change_mps: float, later_s: float) -> Situation:
    """The situation when what a leader has told has been driven; the vehicle ahead goes on."""
    own: Own = s.own
    speed_mps = max(0.0, own.then_mps + change_mps)
    way_m = (own.speed_mps + speed_mps) / 2 * later_s
    motion = s.motion
    if motion is not None:
        motion = replace(motion, gap_m=motion.gap_m + motion.speed_mps * later_s - way_m)
    return replace(
        s,
        own=replace(own, speed_mps=speed_mps, effective_mps=speed_mps),
        place_m=s.place_m + way_m,
        motion=motion,
    )


def cruise_mps(
    situation: Situation, slowdown: float, joining: Joining, before_mps: float | None
) -> float | None:
    """Highest set speed of a vehicle alone, m/s, after that of the interval before, if there was
    one; None: as without platooning.

    A vehicle that catches up with another one itself waits no more than half as much as that one.
    """
    own = situation.own
    if joining.slowdown > 0:
        slowdown = min(slowdown, joining.slowdown / 2)
    if slowdown > 0:
        before_mps = own.speed_mps if before_mps is None else before_mps
        target_mps = (1 - slowdown) * own.desired_mps
        waiting = waiting_mps(before_mps, target_mps, own)
        return min(own.desired_mps, waiting, situation.limit_mps)
    if joining.speedup > 0:
        return min(situation.limit_mps, (1 + joining.speedup) * own.desired_mps)
    return None


def announced_mps(situation: Situation, command_mps: float | None, cap_mps: float) -> float:
    """Speed that others may reckon with at the end of the interval, m/s: of a vehicle alone its
    present motion continued, within the cap.
    """
    own, state = situation.own, situation.state
    if command_mps is None:
        goes_on = max(0.0, own.speed_mps + state.acceleration_mps2 * own.interval_s)
        command_mps = min(goes_on, cap_mps)
    return max(command_mps, situation.lowest_mps)


def obeys(situation: Situation, command_mps: float | None) -> bool:
    """Whether the vehicle drives what it was last commanded; its own safety may hold it back."""
    return command_mps is None or situation.own.speed_mps > command_mps - _OBEYED_MPS
