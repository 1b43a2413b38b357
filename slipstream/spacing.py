"""Gaps: those that followers keep and drivers have, and how leaders let them be closed; as vehicles
control them and plans count on them.

**Greatest closing.** The vehicle ahead brakes from v_f with a, the rear one drives on with v_r for
ρ, then brakes with b. With u = v_r − v_f the gap shrinks at most by the larger of 0 and

    u ρ + a ρ²/2 + (u + a ρ)² / 2(b − a)    where b > a and the speeds meet before the front stands
    v_r ρ + v_r²/2b − v_f²/2a                else: both stand

(S. Shalev-Shwartz, S. Shammah, A. Shashua, On a Formal Model of Safe and Scalable Self-driving
Cars, 2017, definition 1, is the second line). A first-order lag τ of the rear one's brake is
covered by ρ as dead time is: its way is never longer than that of full braking τ later. It grows
with v_r, a and ρ, and falls with v_f and b; `tests/slipstream/test_spacing.py` holds it to both
motions, integrated. It counts on a rear vehicle that does not accelerate within ρ.

**Two levels.** Unannounced, the vehicle ahead may brake with the most that it can. In a close
platoon it has promised not to brake harder than a limit until its follower is apart. Where b is
above a, the gap does not depend on the speed. The limit is what the follower's wanted gap allows
with all of the follower's brake, and below the limit that the follower has promised itself, by
`LIMIT_RATIO`: with that, who brakes as its leader has told stays within its own promise. Where
`LEAST_LIMIT_MPS2` holds a limit up it may need more: the string is no longer than that allows
(`longest_string`). By sensing alone it may need more too: docs/safety.md.

ρ = age of the sensed gap + one interval of control + dead time and lag at their tolerance.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from slipstream.braking import Braking

ADVISED_GAP_M: Final = 2.0
"""Advised where nothing else is."""

RESPONSE_S: Final = 0.1
"""Interval of control: one platoon control message, sent ten times a second."""

CLOSE_GAP_M: Final = 7.5
"""Largest gap for which the paper's drag reductions are credited."""

STANDING_M: Final = 0.5
"""Left between two vehicles that have braked as hard as they must."""

GAP_ERROR_M: Final = 0.1
SPEED_ERROR_MPS: Final = 0.1
"""Of the own sensors, and of a speed that is kept."""

LIMIT_RATIO: Final = 1.15
"""Between the limits of a vehicle and of the one ahead of it: brakes of both may miss what is
commanded by some 5 %, and the rear one has to make up for what it began later."""

LEAST_LIMIT_MPS2: Final = 2.0
"""No vehicle promises to brake less hard: turns, signals and stops ask for as much."""

DRIVER_TIME_GAP_S: Final = 1.2
DRIVER_MIN_GAP_M: Final = 2.5
"""Drivers keep s₀ + v T, by the IDM of vehicles alone."""

ENTRY_HEADWAY_S: Final = 3.0
"""Between vehicles that leave one place in the same second and enter the road one after another."""

MAX_SLOWDOWN: Final = 0.15
"""Largest share that a vehicle takes off its speed so that others catch up: at 30 m/s it is still
faster than trucks, which would else pass it."""

SLOWING_SHARE: Final = 0.9
"""Of the deceleration by coasting, with which it does so."""

MOST_VEHICLES: Final = 10
"""Of a platoon, however they brake: for so many it is shown that no deviation grows."""

_SOFTEST_SHARE: Final = 0.001
_FASTEST_MPS: Final = 36.0


def driver_gap_m(speed_mps: float) -> float:
    """Gap that drivers keep at a speed, m."""
    return DRIVER_MIN_GAP_M + DRIVER_TIME_GAP_S * speed_mps


def closing_m(
    front_mps: float, rear_mps: float, front_mps2: float, rear_mps2: float, response_s: float
) -> float:
    """By how much a gap shrinks at most, m; see the module.

    Args:
        front_mps: v_f ≥ 0, of the vehicle ahead, which brakes now.
        rear_mps: v_r ≥ 0.
        front_mps2: a > 0.
        rear_mps2: b > 0.
        response_s: ρ ≥ 0, for which the rear one drives on.
    """
    a, b, u = front_mps2, rear_mps2, rear_mps - front_mps
    if b > a:
        nearing = u + a * response_s
        meet_s = response_s + max(0.0, nearing) / (b - a)
        if meet_s < front_mps / a:
            if nearing <= 0:
                return 0.0
            met_m = u * response_s + a * response_s**2 / 2 + nearing * nearing / (2 * (b - a))
            return max(0.0, met_m)
    stands_m = rear_mps * response_s + rear_mps * rear_mps / (2 * b)
    return max(0.0, stands_m - front_mps * front_mps / (2 * a))


def reaction_s(braking: Braking, interval_s: float = RESPONSE_S) -> float:
    """ρ of a vehicle that answers what it senses, s."""
    return braking.sensing_s + interval_s + braking.response_s


def least_gap_m(
    speed_mps: float, front_mps2: float, rear: Braking, interval_s: float = RESPONSE_S
) -> float:
    """Least gap at which a follower may drive at a speed, m: it grows with `front_mps2`.

    Args:
        front_mps2: the most that the vehicle ahead brakes with: what it can, or what it promised.
    """
    faster_mps = speed_mps + SPEED_ERROR_MPS
    rho_s = reaction_s(rear, interval_s)
    closing = closing_m(speed_mps, faster_mps, front_mps2, rear.guaranteed_mps2, rho_s)
    return STANDING_M + GAP_ERROR_M + closing


def front_limit_mps2(
    gap_m: float,
    rear: Braking,
    own_limit_mps2: float | None = None,
    interval_s: float = RESPONSE_S,
) -> float:
    """The hardest braking of the vehicle ahead with which a gap is enough at every speed, m/s².

    It is above 0: for a gap that none is soft enough for, next to no braking. It is half of what
    the follower's brake guarantees at most: its own emergency brake, which acts where its agent
    does not, begins later than that.

    Args:
        gap_m: that the follower wants to keep.
        own_limit_mps2: that the follower has promised to its own follower; None: it has none.
    """
    b, rho, u = rear.guaranteed_mps2, reaction_s(rear, interval_s), SPEED_ERROR_MPS
    room_m = gap_m - STANDING_M - GAP_ERROR_M - u * rho
    # The first line of the module's formula, solved for a: its squares cancel.
    limit = (2 * b * room_m - u * u) / (b * rho * rho + 2 * room_m + 2 * u * rho)
    limit = max(_SOFTEST_SHARE * b, min(limit, b / 2)) if room_m > 0 else _SOFTEST_SHARE * b
    return limit if own_limit_mps2 is None else min(limit, own_limit_mps2 / LIMIT_RATIO)


def promised_mps2(wanted_mps2: float, own: Braking) -> float:
    """The limit that a vehicle promises where its follower needs `wanted_mps2`, m/s²."""
    return max(wanted_mps2, min(LEAST_LIMIT_MPS2, own.guaranteed_mps2 / 2))


def wanted_gap_m(
    speed_mps: float,
    advised_gap_m: float,
    front_mps2: float,
    rear: Braking,
    interval_s: float = RESPONSE_S,
) -> float:
    """Gap g* that a follower keeps, m: the advised one, or the least one where that is larger."""
    return max(advised_gap_m, least_gap_m(speed_mps, front_mps2, rear, interval_s))


def planned_gap_m(
    speed_mps: float, advised_gap_m: float, braking: Braking, interval_s: float = RESPONSE_S
) -> float:
    """g* in a close platoon of vehicles of one type, that a plan counts on, m."""
    limit = braking.greatest_mps2
    if braking.emergency_brake:
        needed = front_limit_mps2(advised_gap_m, braking, interval_s=interval_s)
        limit = promised_mps2(needed, braking)
    return wanted_gap_m(speed_mps, advised_gap_m, limit, braking, interval_s)


@lru_cache(maxsize=256)
def longest_string(advised_gap_m: float, braking: Braking) -> int:
    """Number of vehicles of one type up to which each one in a close platoon that has heard its
    leader stops behind it within what it has promised itself, from 2 to `MOST_VEHICLES`.

    The limits fall from the rear to the front by `LIMIT_RATIO` until `LEAST_LIMIT_MPS2` holds them
    up: a vehicle farther in front would have to brake harder than it may. Who was told when its
    leader brakes begins late by its tolerance, the leader's, and one interval.
    """
    if not braking.emergency_brake:
        # Nothing is promised: each keeps the unannounced gap.
        return MOST_VEHICLES
    late_s = 2 * braking.tolerance * braking.nominal_s + RESPONSE_S
    speed_mps, faster_mps = _FASTEST_MPS, _FASTEST_MPS + SPEED_ERROR_MPS
    own = promised_mps2(front_limit_mps2(advised_gap_m, braking), braking)
    for vehicles in range(2, MOST_VEHICLES):
        front = promised_mps2(front_limit_mps2(advised_gap_m, braking, own), braking)
        closing = closing_m(speed_mps, faster_mps, front, own, late_s)
        kept_m = wanted_gap_m(speed_mps, advised_gap_m, front, braking)
        if STANDING_M + GAP_ERROR_M + closing > kept_m:
            return vehicles
        own = front
    return MOST_VEHICLES
