"""Gap control: speeds that close, keep and open a gap, as pure functions of both motions.

A follower wants the gap g* of `slipstream.spacing`, with a time gap h = `RESPONSE_S`. It is
commanded v = v_ahead + k (g − g*), where v_ahead is the latest speed that is known of the vehicle
ahead, τ old.

**String stability.** Let both speeds deviate from a common one. With g' = v_ahead − v and
v = e^{−τs} v_ahead + k (g − h v), a follower's deviation is G(s) times that of the vehicle ahead,

    G(s) = (s e^{−τs} + k) / (s (1 + k h) + k)

and no deviation grows along a string if |G(jω)| ≤ 1 for all ω (D. Swaroop, J. K. Hedrick, String
stability of interconnected systems, IEEE Trans. Automatic Control 41, 1996; J. Ploeg, N. van de
Wouw, H. Nijmeijer, L_p string stability of cascaded systems: application to vehicle platooning,
IEEE Trans. Control Systems Technology 22, 2014). As

    |jω e^{−jωτ} + k|² = ω² + k² + 2 k ω sin ωτ
    |jω (1 + k h) + k|² = ω² (1 + k h)² + k²

that is 2 sin(ωτ) / ω ≤ 2 h + k h². As sin(ωτ) ≤ ωτ, h ≥ τ is enough. In steps of Δt, with a gap as
new as the step, the same algebra asks for h ≥ Δt where the vehicle ahead is known by its present
speed, and for nothing (h = 0 gives |G| = 1) where it is known what it will drive in the step. For
that the law is solved for v with g* at the commanded speed, not at the present one.

SUMO's CACC is not used: at the evaluation's step its gains answer a braking leader with 9 m/s².
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slipstream.energy.drafting import DragLaw, DragReductions, reductions_at
from slipstream.energy.traction import VehicleParameters, coasting_mps2
from slipstream.spacing import (
    DRIVER_MIN_GAP_M,
    DRIVER_TIME_GAP_S,
    MAX_BRAKING_MPS2,
    RESPONSE_S,
    SLOWING_SHARE,
    wanted_gap_m,
)
from vehicle_agent.platooning.safe_gap import AheadMotion

CLOSE_GAP_M: Final = 7.5
"""Largest gap for which drag reductions are credited."""

MIN_SPEED_MPS: Final = 5.0
"""Below this speed no drag reduction is credited: there is next to no drag."""

COMFORTABLE_MPS2: Final = 2.5
"""Deceleration that nobody minds."""

_GAIN_PER_S: Final = 0.4
_APPROACH_MPS: Final = 0.5
_EXTRA_BRAKING_MPS2: Final = 1.0
_BRAKING_THRESHOLD_MPS2: Final = 0.2
_MIN_GAP_M: Final = 0.5


@dataclass(frozen=True, slots=True)
class Own:
    """A follower.

    Attributes:
        max_mps: that it may drive here.
        desired_mps: that it would drive here alone.
        advised_gap_m: g_advised.
        interval_s: Δt, of its control.
        drafting: law of its drag reduction.
    """

    speed_mps: float
    max_mps: float
    desired_mps: float
    advised_gap_m: float
    interval_s: float
    vehicle: VehicleParameters
    drafting: DragLaw = "paper"

    def reductions(self, speed_mps: float) -> DragReductions:
        """η_drag of each place at the gap that it keeps at a speed."""
        gap_m = wanted_gap_m(speed_mps, self.advised_gap_m, self.interval_s)
        return reductions_at(self.drafting, gap_m)

    @property
    def wanted_gap_m(self) -> float:
        """g* at its present speed."""
        return wanted_gap_m(self.speed_mps, self.advised_gap_m, self.interval_s)

    @property
    def coasting_mps2(self) -> float:
        """Its deceleration without traction and brake."""
        return coasting_mps2(self.speed_mps, self.vehicle)


@dataclass(frozen=True, slots=True)
class Idm:
    """Car-following model of vehicles alone: IDM (Treiber, Hennecke, Helbing 2000)."""

    acceleration_mps2: float = 1.8
    deceleration_mps2: float = COMFORTABLE_MPS2
    time_gap_s: float = DRIVER_TIME_GAP_S
    min_gap_m: float = DRIVER_MIN_GAP_M

    def desired_gap_m(self, speed_mps: float, approach_mps: float = 0.0) -> float:
        """s* = s₀ + max(0, v T + v Δv / 2√(ab))."""
        root = 2 * math.sqrt(self.acceleration_mps2 * self.deceleration_mps2)
        dynamic = speed_mps * self.time_gap_s + speed_mps * approach_mps / root
        return self.min_gap_m + max(0.0, dynamic)

    def acceleration_to_mps2(self, own: Own, gap_m: float, ahead_mps: float) -> float:
        """a (1 − (v/v₀)⁴ − (s*/s)²)."""
        v = own.speed_mps
        wanted_m = self.desired_gap_m(v, v - ahead_mps)
        free = (v / max(own.desired_mps, 0.1)) ** 4
        return self.acceleration_mps2 * (1 - free - (wanted_m / max(gap_m, _MIN_GAP_M)) ** 2)


IDM: Final = Idm()


def following_mps(own: Own, ahead: AheadMotion) -> float:
    """Speed of a follower at the end of the coming interval. Far behind, it closes up no faster
    than it can slow down again by coasting, so that the energy put into catching up is not braked
    away, and brakes no more than it must.
    """
    dt, error_m = own.interval_s, ahead.gap_m - own.wanted_gap_m
    room_m = ahead.gap_m - own.advised_gap_m
    upper = min(own.max_mps, own.speed_mps + IDM.acceleration_mps2 * dt)
    commanded = min(
        (ahead.coming_mps + _GAIN_PER_S * room_m) / (1 + _GAIN_PER_S * RESPONSE_S),
        ahead.coming_mps + _GAIN_PER_S * (room_m - MAX_BRAKING_MPS2 * dt**2),
    )
    if error_m <= 0:
        return max(0.0, min(commanded, upper))
    coasting = own.coasting_mps2
    commanded = min(commanded, ahead.coming_mps + closing_mps(error_m, coasting))
    if error_m > own.wanted_gap_m:
        braking = _required_braking_mps2(own.speed_mps, ahead, error_m)
    else:
        braking = ahead.slowing_mps2 + _EXTRA_BRAKING_MPS2
        braking += max(0.0, own.speed_mps - ahead.speed_mps) ** 2 / (2 * error_m)
    gently = own.speed_mps - max(coasting, braking) * dt
    return max(0.0, min(max(commanded, gently), upper))


def closing_mps(error_m: float, coasting: float) -> float:
    """Difference of speeds that coasting, less a tenth, ends when the gap is closed.

    k e near the wanted gap, where that asks for less than such a deceleration c; u² = 2 c (e − ½ c
    / k²) from there on, which goes over into it without a kink.
    """
    slowing = SLOWING_SHARE * coasting
    linear_m = slowing / _GAIN_PER_S**2
    if error_m <= linear_m:
        return _GAIN_PER_S * max(0.0, error_m)
    return math.sqrt(2 * slowing * (error_m - linear_m / 2))


def _required_braking_mps2(speed_mps: float, ahead: AheadMotion, room_m: float) -> float:
    """Smallest deceleration that avoids the vehicle ahead, which keeps its speed or goes on braking
    to a stand, m/s²: the larger result of the two.
    """
    needed = max(0.0, speed_mps - ahead.speed_mps) ** 2 / (2 * room_m)
    if ahead.slowing_mps2 > _BRAKING_THRESHOLD_MPS2:
        stands_m = ahead.speed_mps**2 / (2 * ahead.slowing_mps2)
        needed = max(needed, speed_mps**2 / (2 * (room_m + stands_m)))
    return needed


def leaving_mps(own: Own, ahead: AheadMotion) -> float:
    """Speed at the end of the coming interval of a vehicle that opens its gap: it coasts, and
    brakes comfortably while it still approaches, as after a cut-in. It never drives faster than a
    follower.
    """
    nearer = own.speed_mps > ahead.speed_mps + _APPROACH_MPS
    lower = -COMFORTABLE_MPS2 if nearer else -own.coasting_mps2
    a = IDM.acceleration_to_mps2(own, ahead.gap_m, ahead.speed_mps)
    a = min(max(a, lower), IDM.acceleration_mps2)
    gently = max(0.0, own.speed_mps + a * own.interval_s)
    return min(gently, following_mps(own, ahead))


def waiting_mps(before_mps: float, target_mps: float, own: Own) -> float:
    """Set speed, after the one of the interval before, of a vehicle that another one catches up
    with: it sinks towards its target as by coasting only.
    """
    return max(target_mps, before_mps - SLOWING_SHARE * own.coasting_mps2 * own.interval_s)


def has_left(own: Own, ahead: AheadMotion) -> bool:
    """Whether the IDM can take over: it would brake no harder than coasting."""
    wanted = IDM.acceleration_to_mps2(own, ahead.gap_m, ahead.speed_mps)
    return wanted >= -own.coasting_mps2


def leaving_distance_m(speed_mps: float, gap_m: float, vehicle: VehicleParameters) -> float:
    """Distance driven until a gap is open (`has_left`), m. Coasting at c, the gap grows by ½ c t²
    and the IDM's wanted one shrinks by v c t / 2√(ab); at 1.3 times the wanted one the IDM coasts
    too.
    """
    c = coasting_mps2(speed_mps, vehicle)
    shrinks = 1.3 * (IDM.desired_gap_m(speed_mps) - IDM.desired_gap_m(speed_mps, -1.0)) * c
    lacks_m = max(0.0, 1.3 * IDM.desired_gap_m(speed_mps) - gap_m)
    seconds = (math.sqrt(shrinks**2 + 2 * c * lacks_m) - shrinks) / c
    return max(0.0, speed_mps * seconds - 0.5 * c * seconds**2)
