"""Gap control: speeds that close, keep and open a gap, as pure functions of both motions.

Keeping: constant-distance following with the speed that the vehicle ahead announces for the end of
the step (the communication in CACC), v = v_ahead' + k (g − g*). SUMO's CACC is not used: at the
evaluation's step its gains answer a braking leader with 9 m/s², and it would give the leader
another car-following model than in every other arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from simulation.sumo import TYPES
from slipstream.energy import PAPER_CAR

ADVISED_GAP_M: Final = 1.5
"""Gap that drag reductions are credited for; see `DispatcherSettings.gap_m`."""

MIN_SPEED_MPS: Final = 5.0
"""Below this speed no drag reduction is credited: there is next to no drag."""

_CAV: Final = TYPES["cav"]
_MAX_BRAKING_MPS2: Final = 9.0
_GAIN_PER_S: Final = 0.4
_APPROACH_MPS: Final = 0.5
_BRAKING_MPS2: Final = _CAV.deceleration_mps2
_EXTRA_BRAKING_MPS2: Final = 1.0
_GAP_SHARE_LEFT: Final = 0.6
_BRAKING_THRESHOLD_MPS2: Final = 0.2
_MIN_GAP_M: Final = 0.5


@dataclass(frozen=True)
class Motion:
    """Speed, desired speed, and gap to the vehicle ahead."""

    speed_mps: float
    desired_mps: float
    gap_m: float


@dataclass(frozen=True)
class Idm:
    """Car-following model of vehicles alone: IDM (Treiber, Hennecke, Helbing 2000)."""

    acceleration_mps2: float = _CAV.acceleration_mps2
    deceleration_mps2: float = _CAV.deceleration_mps2
    time_gap_s: float = _CAV.time_gap_s
    min_gap_m: float = _CAV.min_gap_m

    def desired_gap_m(self, speed_mps: float, approach_mps: float = 0.0) -> float:
        """s* = s₀ + max(0, v T + v Δv / 2√(ab))."""
        root = 2 * math.sqrt(self.acceleration_mps2 * self.deceleration_mps2)
        dynamic = speed_mps * self.time_gap_s + speed_mps * approach_mps / root
        return self.min_gap_m + max(0.0, dynamic)

    def acceleration_to_mps2(self, own: Motion, ahead_mps: float) -> float:
        """a (1 − (v/v₀)⁴ − (s*/s)²)."""
        v = own.speed_mps
        wanted_m = self.desired_gap_m(v, v - ahead_mps)
        free = (v / max(own.desired_mps, 0.1)) ** 4
        return self.acceleration_mps2 * (1 - free - (wanted_m / max(own.gap_m, _MIN_GAP_M)) ** 2)


def followed_gap_m(step_s: float, advised_gap_m: float = ADVISED_GAP_M) -> float:
    """Gap g* that followers keep in a simulation of a step length, m.

    The advised gap plus the distance lost to an emergency braking ahead within one step,
    9 m/s² · step²: 1.6 m at 0.1 s, 3.75 m at 0.5 s.
    """
    return advised_gap_m + _MAX_BRAKING_MPS2 * step_s**2


def close_gap_m(step_s: float) -> float:
    """Largest gap that counts as close following, m: twice the one that followers keep."""
    return 2 * followed_gap_m(step_s)


def coasting_mps2(speed_mps: float) -> float:
    """Deceleration without traction and brake, m/s²."""
    return (PAPER_CAR.rolling_force_n + PAPER_CAR.drag_force_n(speed_mps)) / PAPER_CAR.mass_kg


def following_mps(
    own: Motion, now_mps: float, coming_mps: float, max_mps: float, step_s: float
) -> float:
    """Speed of a follower at the end of the coming step.

    Far behind, it closes up no faster than it can slow down again by coasting, so that the energy
    put into catching up is not braked away, and brakes no more than it must. Close behind, it
    brakes as the vehicle ahead does, and by 1 m/s² more at most unless most of the gap is gone.

    Args:
        own: follower.
        now_mps: speed of the vehicle ahead.
        coming_mps: speed that it will have at the end of the step.
        max_mps: that the follower may drive.
        step_s: of the simulation.
    """
    wanted_m = followed_gap_m(step_s)
    error_m = own.gap_m - wanted_m
    closing = _GAIN_PER_S * error_m
    slowing = max(0.0, now_mps - coming_mps) / step_s
    if error_m > 0:
        coasting = coasting_mps2(own.speed_mps)
        closing = min(closing, math.sqrt(2 * 0.9 * coasting * error_m))
        if own.gap_m > close_gap_m(step_s):
            braking = _required_braking_mps2(own.speed_mps, now_mps, slowing, error_m)
        else:
            braking = slowing + _required_braking_mps2(own.speed_mps, now_mps, 0.0, error_m)
        braking = max(coasting, braking)
    elif own.gap_m >= _GAP_SHARE_LEFT * wanted_m:
        braking = slowing + _EXTRA_BRAKING_MPS2
    else:
        braking = _MAX_BRAKING_MPS2
    upper = own.speed_mps + Idm().acceleration_mps2 * step_s
    lower = own.speed_mps - min(braking, _MAX_BRAKING_MPS2) * step_s
    return max(0.0, lower, min(coming_mps + closing, upper, max_mps))


def _required_braking_mps2(
    speed_mps: float, ahead_mps: float, slowing_mps2: float, room_m: float
) -> float:
    """Smallest deceleration that avoids the vehicle ahead, m/s².

    That vehicle keeps its speed, or goes on braking to a stand: the larger result of the two.
    """
    needed = max(0.0, speed_mps - ahead_mps) ** 2 / (2 * room_m)
    if slowing_mps2 > _BRAKING_THRESHOLD_MPS2:
        stands_m = ahead_mps**2 / (2 * slowing_mps2)
        needed = max(needed, speed_mps**2 / (2 * (room_m + stands_m)))
    return needed


def leaving_mps(own: Motion, now_mps: float, coming_mps: float, step_s: float) -> float:
    """Speed at the end of the coming step of a vehicle that opens its gap.

    It coasts, and brakes comfortably while it still approaches, as after a cut-in. It never drives
    faster than a follower.

    Args:
        own: the vehicle.
        now_mps: speed of the vehicle ahead.
        coming_mps: speed that it will have at the end of the step.
        step_s: of the simulation.
    """
    nearer = own.speed_mps > now_mps + _APPROACH_MPS
    lower = -_BRAKING_MPS2 if nearer else -coasting_mps2(own.speed_mps)
    a = min(max(Idm().acceleration_to_mps2(own, now_mps), lower), Idm().acceleration_mps2)
    gently = max(0.0, own.speed_mps + a * step_s)
    return min(gently, following_mps(own, now_mps, coming_mps, own.desired_mps, step_s))


def waiting_mps(speed_mps: float, target_mps: float, step_s: float) -> float:
    """Largest speed of a vehicle that another one catches up with: it slows by coasting only."""
    return max(target_mps, speed_mps - 0.9 * coasting_mps2(speed_mps) * step_s)


def has_left(own: Motion, ahead_mps: float) -> bool:
    """Whether the IDM can take over: it would brake no harder than coasting."""
    return Idm().acceleration_to_mps2(own, ahead_mps) >= -coasting_mps2(own.speed_mps)


def leaving_distance_m(speed_mps: float, gap_m: float) -> float:
    """Distance driven until a gap is open (`has_left`), m.

    Coasting at c, the gap grows by ½ c t² and the IDM's wanted one shrinks by v c t / 2√(ab); at
    1.3 times the wanted one the IDM coasts too.
    """
    idm, c = Idm(), coasting_mps2(speed_mps)
    shrinks = 1.3 * (idm.desired_gap_m(speed_mps) - idm.desired_gap_m(speed_mps, -1.0)) * c
    lacks_m = max(0.0, 1.3 * idm.desired_gap_m(speed_mps) - gap_m)
    seconds = (math.sqrt(shrinks**2 + 2 * c * lacks_m) - shrinks) / c
    return max(0.0, speed_mps * seconds - 0.5 * c * seconds**2)
