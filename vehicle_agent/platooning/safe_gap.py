"""The speed that still leaves a safe gap: responsibility-sensitive safety (RSS).

S. Shalev-Shwartz, S. Shammah, A. Shashua, On a Formal Model of Safe and Scalable Self-driving Cars,
2017, definition 1: a gap is safe if the vehicle ahead may brake as hard as it can, the rear one
answers after a response time ρ, and they do not touch. Its driver's response time gives way to that
of communication and control, and the rear one's assumed acceleration within ρ to its command:

    g + s_front ≥ g₀ + (max(v, v_f) + c) Δt / 2 + c² / 2b

g is the gap, g₀ what is left of it at a stand, v and v_f both speeds, c the command, which is
reached at the end of the control interval Δt, b = 9 m/s² what either brakes with at its strongest.
s_front is the way in which the vehicle ahead comes to a stand:

- by its sensed motion alone it may brake with b from now on: v_f² / 2b, so ρ = Δt;
- while its messages are fresh it drives to the speed that it announced, and may brake with b
  unannounced for ρ = max(`RESPONSE_S`, age of the message) before the interval ends. At
  Δt = 0.1 s this is the same as before: nothing depends on what a partner announced. Longer
  intervals are those of an evaluation, in which an announced speed is a command.

max(v, v_f) in place of v covers a simulation too that moves vehicles by the speed at a step's end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slipstream.spacing import MAX_BRAKING_MPS2

STANDING_M: Final = 0.5
"""Left between two vehicles that have braked to a stand."""


@dataclass(frozen=True, slots=True)
class AheadMotion:
    """The vehicle directly ahead.

    Attributes:
        coming_mps: the latest speed that is known of it: what it announced for a moment that is
            still to come, or the sensed one.
        trusted_s: how much of the control interval its announcement covers; 0: none of it.
        coming_in_s: from now to the moment that it is announced for.
        slowing_mps2: its deceleration as it told; 0: none.
    """

    gap_m: float
    speed_mps: float
    coming_mps: float
    trusted_s: float = 0.0
    coming_in_s: float = 0.0
    slowing_mps2: float = 0.0


def stopping_m(speed_mps: float) -> float:
    """Way to a stand at the strongest braking."""
    return speed_mps * speed_mps / (2 * MAX_BRAKING_MPS2)


def front_way_m(ahead: AheadMotion) -> float:
    """Shortest way in which the vehicle ahead comes to a stand, as far as is known of it."""
    if ahead.trusted_s <= 0:
        return stopping_m(ahead.speed_mps)
    share = min(1.0, ahead.trusted_s / ahead.coming_in_s)
    then_mps = ahead.speed_mps + share * (ahead.coming_mps - ahead.speed_mps)
    return (ahead.speed_mps + then_mps) / 2 * ahead.trusted_s + stopping_m(then_mps)


def safe_mps(speed_mps: float, ahead: AheadMotion, interval_s: float) -> float:
    """The highest safe command, reached at the end of the interval; 0 where none is: then nothing
    but the strongest braking is left.
    """
    room_m = ahead.gap_m - STANDING_M + front_way_m(ahead)
    room_m -= max(speed_mps, ahead.speed_mps) / 2 * interval_s
    # A slower vehicle ahead must not be met within the interval either.
    approach_mps = speed_mps - min(ahead.speed_mps, ahead.coming_mps)
    if room_m <= 0 or ahead.gap_m < approach_mps / 2 * interval_s:
        return 0.0
    half = MAX_BRAKING_MPS2 * interval_s / 2
    return math.sqrt(half * half + 2 * MAX_BRAKING_MPS2 * room_m) - half
