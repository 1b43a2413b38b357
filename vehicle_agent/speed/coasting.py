"""Coasting: motion without traction and brakes, and when to begin it before a lower speed.

A vehicle without traction and brakes is slowed by m dv/dt = −(r + k v²), r the rolling resistance
and k v² the drag. Speed over time, distance over time and distance over speed have closed forms.

**When to begin.** What is least for a price of time p (W) is ∫ (F/η + p/v) dx over the traction
F >= 0 on the way to a place with speed v_t. Let K = ½mv², dK/dx = F − B − R with R = r + k v² and
the brakes' force B >= 0, and λ the costate of K. The Hamiltonian

    H = F/η + p/v + λ (F − B − R)

does not depend on x, so it is constant (Pontryagin). It is least with full traction where
λ < −1/η, with any where λ = −1/η (cruising), with none where −1/η < λ < 0 (rolling) and with the
brakes where λ > 0. Where rolling begins, at v₀, λ = −1/η and H = p/v₀ + R(v₀)/η. Where it ends and
braking begins, at v_c, λ = 0 and H = p/v_c. Hence

    1/v_c = 1/v₀ + R(v₀) / (η p)

and, above v_t, braking from v_c to v_t. It holds for cruising at a limit and for accelerating (v₀
is then the highest speed reached, and there is no cruising). While v rolls down from v₀, the v_c
that this would give for v gets lower and the road that is needed longer than the road that is left:
a vehicle that has begun to coast also finds coasting optimal later, so no memory is needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from slipstream.energy.traction import PAPER_CAR, VehicleParameters


@dataclass(frozen=True)
class CoastingModel:
    """The motion of a vehicle without traction and without brakes: r, k, m and η."""

    rolling_n: float
    drag_kgpm: float
    mass_kg: float
    efficiency: float

    @classmethod
    def of(cls, vehicle: VehicleParameters = PAPER_CAR) -> CoastingModel:
        """Of a vehicle that drives alone."""
        return cls(
            vehicle.rolling_force_n,
            vehicle.drag_factor_kgpm,
            vehicle.mass_kg,
            vehicle.powertrain_efficiency,
        )

    def resistance_n(self, speed_mps: float) -> float:
        """R = r + k v²."""
        return self.rolling_n + self.drag_kgpm * speed_mps * speed_mps

    def after(self, speed_mps: float, seconds: float) -> float:
        """Speed after rolling for a time, m/s; 0 where it has come to a stand."""
        scale = math.sqrt(self.drag_kgpm / self.rolling_n)
        turned = math.atan(speed_mps * scale) - seconds * self._rate_per_s
        return math.tan(turned) / scale if turned > 0 else 0.0

    def distance_m(self, from_mps: float, to_mps: float) -> float:
        """Road that rolling takes from one speed down to another; 0 if that is not lower."""
        if to_mps >= from_mps:
            return 0.0
        ratio = self.resistance_n(from_mps) / self.resistance_n(to_mps)
        return 0.5 * self.mass_kg / self.drag_kgpm * math.log(ratio)

    def duration_s(self, from_mps: float, to_mps: float) -> float:
        """Time that rolling takes from one speed down to another; 0 if that is not lower."""
        if to_mps >= from_mps:
            return 0.0
        scale = math.sqrt(self.drag_kgpm / self.rolling_n)
        return (math.atan(from_mps * scale) - math.atan(to_mps * scale)) / self._rate_per_s

    def speed_for(self, distance_m: float, seconds: float) -> float:
        """The speed from which rolling a distance takes a time, m/s: v = √(r/k) (exp(kd/m) − cos τ)
        / sin τ with τ = t √(rk)/m, the distance rolled in t solved for the first speed. May be one
        from which the vehicle would stand still before.
        """
        tau = min(seconds * self._rate_per_s, 1.5)
        reach = math.exp(self.drag_kgpm * distance_m / self.mass_kg)
        return math.sqrt(self.rolling_n / self.drag_kgpm) * (reach - math.cos(tau)) / math.sin(tau)

    def braking_speed(self, from_mps: float, value_of_time_w: float) -> float:
        """v_c: where rolling from a speed should end for a price of time; see above."""
        return 1 / (
            1 / from_mps + self.resistance_n(from_mps) / (self.efficiency * value_of_time_w)
        )

    def approach_m(
        self, speed_mps: float, slow_mps: float, value_of_time_w: float, braking_mps2: float
    ) -> float:
        """Distance of coasting and braking from a speed to a lower one, for a value of time, m."""
        if speed_mps <= slow_mps:
            return 0.0
        lower_mps = max(slow_mps, self.braking_speed(speed_mps, value_of_time_w))
        return self.distance_m(speed_mps, lower_mps) + braking_m(lower_mps, slow_mps, braking_mps2)

    def lost_s(
        self, speed_mps: float, slow_mps: float, value_of_time_w: float, braking_mps2: float
    ) -> float:
        """Time that coasting adds to an approach with braking at the last moment, s."""
        if speed_mps <= slow_mps:
            return 0.0
        lower_mps = max(slow_mps, self.braking_speed(speed_mps, value_of_time_w))
        at_speed_m = self.distance_m(speed_mps, lower_mps) - braking_m(
            speed_mps, lower_mps, braking_mps2
        )
        braked_s = (speed_mps - lower_mps) / braking_mps2
        return self.duration_s(speed_mps, lower_mps) - at_speed_m / speed_mps - braked_s

    @property
    def _rate_per_s(self) -> float:
        return math.sqrt(self.rolling_n * self.drag_kgpm) / self.mass_kg


def braking_m(from_mps: float, to_mps: float, braking_mps2: float) -> float:
    """Road that braking takes from one speed down to another; 0 if that is not lower."""
    if to_mps >= from_mps:
        return 0.0
    return 0.5 * (from_mps * from_mps - to_mps * to_mps) / braking_mps2


def braked_mps(distance_m: float, slow_mps: float, braking_mps2: float) -> float:
    """Speed from which braking reaches a lower speed within a distance."""
    return math.sqrt(slow_mps * slow_mps + 2 * braking_mps2 * max(0.0, distance_m))
