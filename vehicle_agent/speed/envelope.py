"""The ceiling of all advice: the limit, room to brake for what lies ahead, and a safe gap.

It bounds advice and gives none: a vehicle that needs no advice is not slowed down by it. Below it a
vehicle can always brake at HARD_MPS2 to every lower limit, turn, place where it gives way and to
its leg's end.

**Signals.** A stop line is a place to stop at while its movement has no green. What is announced
does not help: a green that is told for the moment of arrival may be changed until then. Two cases
differ. In a green whose end and yellow are fixed, a vehicle that cannot be through before red, not
even by accelerating, has to stop for it at once. One that is too near to stop at HARD_MPS2 may go
on while it is yellow, and brakes at that rate if it is red.

An intersection that has told nothing for two seconds shows something that only the driver sees. To
stop there would stop at green. Then no speed may be commanded: `Ceiling.signal_unknown` says so
where the stop line is so near that it matters, and the agent leaves the speed to the driver.

**Gap.** A vehicle keeps the safe longitudinal distance of responsibility-sensitive safety (RSS,
Shalev-Shwartz, Shammah, Shashua 2017) to the one ahead: if that one brakes fully now, it stops
behind it after RESPONSE_S without reaction. Both are taken to brake equally hard, as in the safe
speed of Krauss (1998): a driver who keeps a second is farther behind.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Final, NamedTuple

from slipstream.messages import SensedVehicle
from vehicle_agent.free_drive import free_drive_s
from vehicle_agent.leg import Leg, StopLine, VehicleState
from vehicle_agent.signals import SignalTimings

HARD_MPS2: Final = 2.5
"""Rate of braking that everything known ahead can be met with; comfortable is up to 1.5."""

FULL_MPS2: Final = 9.0
"""What the vehicle ahead, and the own one behind it, brake with in an emergency."""

RESPONSE_S: Final = 0.5

LINE_GAP_M: Final = 0.5
"""From the front to a stop line that it stops at; drivers leave more."""

_NEAR_S: Final = 1.0
"""A stop line of unknown state matters this long before braking for it would have to begin."""


class Ceiling(NamedTuple):
    """The ceiling of advice at the end of the coming interval; `signal_unknown`: the driver alone
    sees what the signal ahead shows.
    """

    speed_mps: float
    signal_unknown: bool


def ceiling(
    leg: Leg,
    state: VehicleState,
    timings: SignalTimings,
    now_s: float,
    interval_s: float,
    ahead: SensedVehicle | None,
    hard_mps2: float = HARD_MPS2,
) -> Ceiling:
    """The largest speed that may be advised until the next advice.

    Args:
        interval_s: until the next advice can change anything.
        ahead: a vehicle to keep a safe gap to; None: none, or platooning keeps the gap.
        hard_mps2: with which places ahead are met, where that is less than HARD_MPS2: a leader of a
            close platoon has promised not to brake harder. Stop lines are met with HARD_MPS2 all
            the same: a yellow leaves no longer way to a stand.
    """
    place_m, speed = leg.place_m(state), state.speed_mps
    crossing = leg.planned[state.number].crossing if state.crossing else None
    limit = leg.limits_mps[state.number] if crossing is None else crossing.speed_mps
    cap = limit
    braking_m = max(speed, limit) * interval_s + limit * limit / (2 * hard_mps2)
    for slow in leg.slow_ahead(place_m):
        ahead_m = slow.at_m - place_m
        if ahead_m > braking_m:
            break
        cap = min(cap, braked_after_mps(speed, slow.speed_mps, ahead_m, hard_mps2, interval_s))
    if place_m >= leg.length_m:
        cap = 0.0
    unknown = False
    reach_m = place_m + braking_m + limit * _NEAR_S
    first = bisect_right(leg.lines, place_m, key=lambda line: line.at_m)
    for line in leg.lines[first:]:
        if line.at_m > reach_m:
            break
        away_m = line.at_m - place_m
        bound = _line_mps(line, state, away_m, limit, timings, now_s, interval_s)
        if bound is None:
            unknown = True
        else:
            cap = min(cap, bound)
    if ahead is not None:
        # It stops that far ahead; behind it, braking fully from the speed after the response.
        free_m = ahead.gap_m + ahead.speed_mps * ahead.speed_mps / (2 * FULL_MPS2)
        response_s = max(RESPONSE_S, interval_s)
        cap = min(cap, braked_after_mps(speed, 0.0, free_m, FULL_MPS2, response_s))
    return Ceiling(cap, unknown)


def braked_after_mps(
    speed_mps: float, slow_mps: float, distance_m: float, braking_mps2: float, seconds: float
) -> float:
    """Largest speed after some time from which braking still meets a lower speed at a place, m/s.

    The root c of c² + 2b t max(c, (v + c)/2) = s² + 2bd: on the way to c the vehicle drives at the
    mean of both speeds where it slows down, and at c at most where it speeds up. Not less than the
    lower speed itself; 0 for values so large that the root is not a number.
    """
    b, t = braking_mps2, seconds
    square = slow_mps * slow_mps + 2 * b * distance_m
    within = b * t * b * t + 4 * (square - b * speed_mps * t)
    slowing = 0.5 * (math.sqrt(within) - b * t) if within > 0 else 0.0
    if slowing > speed_mps:
        slowing = math.sqrt(b * t * b * t + square) - b * t
    return max(slow_mps, slowing) if slowing >= 0 else slow_mps


def _line_mps(
    line: StopLine,
    state: VehicleState,
    ahead_m: float,
    limit_mps: float,
    timings: SignalTimings,
    now_s: float,
    interval_s: float,
) -> float | None:
    """What a stop line allows; infinite where the vehicle may pass it, None if that is unknown."""
    speed = state.speed_mps
    group = line.group(state.lane if state.number == line.number else None)
    shown = timings.indication(line.intersection, group, now_s)
    if shown is None:
        return None
    if shown.may_go and now_s + free_drive_s(ahead_m, speed, limit_mps) <= shown.red_s:
        return math.inf
    can_stop = speed * speed <= 2 * HARD_MPS2 * ahead_m
    if not can_stop and (shown.may_go or shown.clearing):
        return math.inf
    stopping = braked_after_mps(speed, 0.0, ahead_m - LINE_GAP_M, HARD_MPS2, interval_s)
    hard = speed - HARD_MPS2 * interval_s
    if can_stop:
        # Nearer to the line than the gap, it need not brake harder.
        hard = min(hard, braked_after_mps(speed, 0.0, ahead_m, HARD_MPS2, interval_s))
    return max(stopping, hard)
