"""The coming interval's speed: commanded while a vehicle follows or leaves, else its set speed."""

from __future__ import annotations

from slipstream.messages import PlatoonControl, PlatoonMode
from slipstream.spacing import MAX_BRAKING_MPS2
from vehicle_agent.platooning.agreement import Joining
from vehicle_agent.platooning.gap_control import following_mps, leaving_mps, waiting_mps
from vehicle_agent.platooning.safe_gap import safe_mps
from vehicle_agent.platooning.situation import Situation, allowed_mps


def commanded_mps(
    situation: Situation, mode: PlatoonMode, front: PlatoonControl | None, cap_mps: float
) -> float | None:
    """Speed at the end of the interval, m/s; None while it drives alone.

    At most the limit here. Otherwise never less than the strongest braking reaches: where the gap
    is unsafe at any speed, or a limit was missed, that is what is commanded.

    Args:
        situation: now.
        mode: of the vehicle.
        front: last message of the vehicle that it follows; while no vehicle is sensed ahead, it
            drives no faster than that one.
        cap_mps: what the rest of the agent allows.
    """
    if mode == "alone":
        return None
    own, ahead = situation.own, situation.motion
    bound = min(allowed_mps(situation), cap_mps)
    if ahead is None:
        command = own.speed_mps if front is None else min(own.speed_mps, front.announced_mps)
    else:
        law = following_mps if mode == "following" else leaving_mps
        command = min(law(own, ahead), safe_mps(own.speed_mps, ahead, own.interval_s))
    lowest = max(0.0, own.speed_mps - MAX_BRAKING_MPS2 * own.interval_s)
    return min(max(min(command, bound), lowest), situation.limit_mps)


def cruise_mps(
    situation: Situation, slowdown: float, joining: Joining, before_mps: float | None
) -> float | None:
    """Highest set speed of a vehicle alone, m/s; None: as without platooning.

    A vehicle that catches up with another one itself waits no more than half as much as that one.

    Args:
        situation: now.
        slowdown: share of its speed that it takes off.
        joining: whom it catches up with.
        before_mps: the set speed of the interval before; None: there was none.
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
    """Speed that others may reckon with at the end of the interval, m/s.

    That of a vehicle alone is its present motion continued, within the cap.
    """
    own, state = situation.own, situation.state
    lowest = max(0.0, own.speed_mps - MAX_BRAKING_MPS2 * own.interval_s)
    if commanded is None:
        goes_on = max(0.0, own.speed_mps + state.acceleration_mps2 * own.interval_s)
        commanded = min(goes_on, cap_mps)
    return max(commanded, lowest)
