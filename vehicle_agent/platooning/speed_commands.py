"""The coming interval's speed: commanded while a vehicle follows or leaves, else its set speed."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from slipstream.messages import PlatoonControl, PlatoonMode
from vehicle_agent.platooning.agreement import Joining
from vehicle_agent.platooning.gap_control import (
    COMFORTABLE_MPS2,
    IDM,
    following_mps,
    leaving_mps,
    waiting_mps,
)
from vehicle_agent.platooning.safe_gap import safe_mps
from vehicle_agent.platooning.situation import Situation, allowed_mps

_OBEYED_MPS: Final = 0.05


def commanded_mps(
    situation: Situation, mode: PlatoonMode, front: PlatoonControl | None, cap_mps: float
) -> float | None:
    """Speed at the end of the interval, m/s, within `cap_mps` of the rest of the agent; None while
    it drives alone.

    At most the limit here. Otherwise never less than the strongest braking reaches: where the gap
    is unsafe at any speed, or a limit was missed, that is what is commanded. The age of the own
    sensing widens the gap by coasting, or comfortable braking where the gap is not safe at that
    age; never harder for the age alone.

    While no vehicle is sensed ahead, it drives no faster than `front`, which it follows, told.
    Where that one has told of another lane it is not in the way, and coasting is enough.
    """
    if mode == "alone":
        return None
    own, ahead = situation.own, situation.motion
    bound = min(allowed_mps(situation), cap_mps)
    if ahead is None:
        command = own.speed_mps
        if front is not None and front.announced_mps < own.speed_mps:
            command = front.announced_mps
            if on_another_lane(situation, front):
                command = max(command, own.speed_mps - own.coasting_mps2 * own.interval_s)
    else:
        law = following_mps if mode == "following" else leaving_mps
        command = min(law(own, ahead), safe_mps(own.speed_mps, ahead, own.interval_s))
        if situation.margin_m > 0:
            wider = replace(ahead, gap_m=ahead.gap_m - situation.margin_m)
            coasting = own.speed_mps - own.coasting_mps2 * own.interval_s
            gently = own.speed_mps - COMFORTABLE_MPS2 * own.interval_s
            safe = max(gently, safe_mps(own.speed_mps, wider, own.interval_s))
            command = min(command, max(coasting, law(own, wider)), safe)
    return min(max(min(command, bound), situation.lowest_mps), situation.limit_mps)


def on_another_lane(situation: Situation, front: PlatoonControl) -> bool:
    """Whether a vehicle has told of another lane of the same segment."""
    state = situation.state
    same = front.path[0] == state.segment and not (front.crossing or state.crossing)
    return same and front.lane != state.lane


def leading_mps(situation: Situation, set_mps: float, cap_mps: float) -> float:
    """Speed at the end of the interval of a leader, m/s: it is commanded as its followers are, so
    it drives what it announces. Behind others it keeps the gap of a driver alone. A lower set speed
    it reaches by coasting.
    """
    own, ahead = situation.own, situation.motion
    gently = own.speed_mps - 0.9 * own.coasting_mps2 * own.interval_s
    command = max(gently, min(set_mps, own.speed_mps + IDM.acceleration_mps2 * own.interval_s))
    if ahead is not None:
        wanted = IDM.acceleration_to_mps2(own, ahead.gap_m, ahead.speed_mps)
        command = min(command, own.speed_mps + wanted * own.interval_s)
    return min(
        max(min(command, allowed_mps(situation), cap_mps), situation.lowest_mps),
        situation.limit_mps,
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


def announced_mps(situation: Situation, commanded: float | None, cap_mps: float) -> float:
    """Speed that others may reckon with at the end of the interval, m/s: of a vehicle alone its
    present motion continued, within the cap.
    """
    own, state = situation.own, situation.state
    if commanded is None:
        goes_on = max(0.0, own.speed_mps + state.acceleration_mps2 * own.interval_s)
        commanded = min(goes_on, cap_mps)
    return max(commanded, situation.lowest_mps)


def obeys(situation: Situation, commanded: float | None) -> bool:
    """Whether the vehicle drives what it was last commanded; its own safety may hold it back."""
    return commanded is None or situation.own.speed_mps > commanded - _OBEYED_MPS
