"""Gap control: accelerations that close, keep and open a gap, as pure functions of both motions.

A follower at the speed v with the gap g and the wanted gap g* is commanded

    a = f + K (r + φ(g − g*) − v)

f is the acceleration that the leader of its platoon drives in this very interval: it tells
accelerations before it drives them. r is the speed of the vehicle ahead, mixed with the leader's:
r = w v_leader + (1 − w) v_ahead. φ is the speed by which the gap is closed or opened, k (g − g*)
near zero. K is 1/2T, with T the dead time and lag of the own brake, and 1/Δt at most.

**String stability.** Where a vehicle alone deviates, by what the leader did not tell, the next one
deviates by G(s) times as much,

    G(s) = K ((1 − w) s + k) / (s² + K s + K k)

|G(jω)| ≤ 1 for all ω where K (1 − (1 − w)²) ≥ 2 k (D. Swaroop, J. K. Hedrick, String stability of
interconnected systems, IEEE Trans. Automatic Control 41, 1996). That holds to K = 1 with w = 0.6
and k = 0.4. Without the leader w is 0 and it does not: then the gap has to grow with the speed,
as the unannounced one does.

SUMO's CACC is not used: at the evaluation's step its gains answer a braking leader with 9 m/s².
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from slipstream.braking import Braking
from slipstream.energy.drafting import DragLaw, DragReductions, reductions_at
from slipstream.energy.traction import VehicleParameters, coasting_mps2
from slipstream.spacing import (
    DRIVER_MIN_GAP_M,
    DRIVER_TIME_GAP_S,
    SLOWING_SHARE,
    longest_string,
    planned_gap_m,
)
from vehicle_agent.platooning.needed_braking import AheadMotion, braking_mps2

MIN_SPEED_MPS: Final = 5.0
"""Below this speed no drag reduction is credited: there is next to no drag."""

COMFORTABLE_MPS2: Final = 2.5
"""Deceleration that nobody minds."""

_GAIN_PER_S: Final = 0.4
_LEADERS_SHARE: Final = 0.6
_OPENING_MPS: Final = 1.0
_OPENING_MPS2: Final = 0.7
SOFT_MPS2: Final = 0.5
_OPENS_M: Final = 1.0
_OPENS_MPS: Final = 0.2
_SHRINKS_M: Final = 0.1
_OWN_MPS2: Final = 1.0
_APPROACH_MPS: Final = 0.5
_EXTRA_BRAKING_MPS2: Final = 1.0
_MIN_GAP_M: Final = 0.5


@dataclass(frozen=True, slots=True)
class Own:
    """A follower.

    Attributes:
        max_mps: that it may drive here.
        desired_mps: that it would drive here alone.
        advised_gap_m: g_advised.
        interval_s: Δt, of its control.
        braking: of the vehicle, on the road as it is.
        drafting: law of its drag reduction.
        effective_mps: its speed when a command of now takes effect; None: the present one.
    """

    speed_mps: float
    max_mps: float
    desired_mps: float
    advised_gap_m: float
    interval_s: float
    vehicle: VehicleParameters
    braking: Braking
    drafting: DragLaw = "paper"
    effective_mps: float | None = None

    def reductions(self, speed_mps: float) -> DragReductions:
        """η_drag of each place at the gap that it keeps at a speed."""
        return reductions_at(self.drafting, self.close_gap_m(speed_mps))

    def close_gap_m(self, speed_mps: float) -> float:
        """g* in a close platoon of its like."""
        return planned_gap_m(speed_mps, self.advised_gap_m, self.braking, self.interval_s)

    @property
    def longest_string(self) -> int:
        """Number of vehicles up to which its platoon may have grown."""
        return longest_string(self.advised_gap_m, self.braking)

    @property
    def then_mps(self) -> float:
        """Its speed when a command of now takes effect."""
        return self.speed_mps if self.effective_mps is None else self.effective_mps

    @property
    def gain_per_s(self) -> float:
        """K: with a larger one the delay of its brake makes it swing."""
        nominal_s = self.braking.nominal_s
        return 1 / self.interval_s if nominal_s <= 0 else min(1 / self.interval_s, 0.5 / nominal_s)

    @property
    def comfortable_mps2(self) -> float:
        """Deceleration to command for a comfortable one, as its brake may do more."""
        return self.braking.commanded_mps2(COMFORTABLE_MPS2)

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


def following_mps2(own: Own, ahead: AheadMotion, wanted_m: float, *, softly: bool = True) -> float:
    """Acceleration of a follower. Far behind, it closes up no faster than it can slow down again by
    coasting, so that the energy put into catching up is not braked away, and brakes no more than it
    must. A gap that is too small opens by 1 m/s, and no harder than with 0.7 m/s², as those ahead
    may do too. More than a comfortable deceleration, or 1 m/s² beyond the told one, is left to
    `needed_mps2`.

    Args:
        wanted_m: g*.
        softly: a gap that lacks more than 1 m opens by coasting, once it grows by 0.2 m/s; what it
            shrinks by before ends within 0.1 m. The vehicle ahead keeps what it has promised until
            both are apart.
    """
    error_m, coasting = ahead.gap_m - wanted_m, own.coasting_mps2
    if error_m > 0:
        drift_mps = closing_mps(error_m, coasting)
    else:
        drift_mps = max(_GAIN_PER_S * error_m, -_OPENING_MPS)
    reference_mps = ahead.speed_mps
    if ahead.leader_mps is not None:
        reference_mps += _LEADERS_SHARE * (ahead.leader_mps - ahead.speed_mps)
    gain, faster_mps = own.gain_per_s, own.speed_mps - reference_mps
    if softly and error_m < -_OPENS_M:
        opening = coasting
        if faster_mps > -_OPENS_MPS:
            shrinks_mps = max(0.0, faster_mps)
            opening = SOFT_MPS2 + min(gain * shrinks_mps, shrinks_mps**2 / (2 * _SHRINKS_M))
        feedback = max(gain * (drift_mps - faster_mps), -opening)
    else:
        feedback = -gain * faster_mps + max(gain * drift_mps, -_OPENING_MPS2)
    a = max(ahead.feed_mps2 + feedback, min(ahead.feed_mps2 - _OWN_MPS2, -own.comfortable_mps2))
    if error_m > 0:
        if error_m > wanted_m:
            slowing = ahead.slowing_mps2
            braking = braking_mps2(own.speed_mps, ahead.speed_mps, slowing, error_m)
        else:
            braking = ahead.slowing_mps2 + _EXTRA_BRAKING_MPS2
            braking += max(0.0, own.speed_mps - ahead.speed_mps) ** 2 / (2 * error_m)
        a = max(a, -max(coasting, braking))
    return min(a, IDM.acceleration_mps2)


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


def leaving_mps2(own: Own, ahead: AheadMotion, wanted_m: float) -> float:
    """Acceleration of a vehicle that opens its gap: it coasts, and brakes comfortably while it
    still approaches, as after a cut-in. It never drives faster than a follower.
    """
    nearer = own.speed_mps > ahead.speed_mps + _APPROACH_MPS
    lower = -COMFORTABLE_MPS2 if nearer else -own.coasting_mps2
    a = IDM.acceleration_to_mps2(own, ahead.gap_m, ahead.speed_mps)
    a = min(max(a, lower), IDM.acceleration_mps2)
    return min(a, following_mps2(own, ahead, wanted_m, softly=False))


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
