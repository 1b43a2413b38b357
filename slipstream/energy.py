"""Physics of traction: wheel power, drag reduction in platoons, electrical energy.

Formulas: paper section II. Regeneration is excluded, so energies are gross traction demand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

JOULE_PER_KWH = 3.6e6
ETA_ALONE = 0.0
ETA_LEADER = 0.05
ETA_FOLLOWER = 0.20


@dataclass(frozen=True)
class VehicleParameters:
    """A vehicle's physical data; the paper's electric car is the default (section II-A).

    Attributes:
        mass_kg: m.
        drag_coefficient: C_d, dimensionless.
        frontal_area_m2: A.
        rolling_resistance: f_r, dimensionless.
        powertrain_efficiency: η_elec, in (0, 1].
        air_density_kgpm3: ρ.
        gravity_mps2: g.
    """

    mass_kg: float = 1800.0
    drag_coefficient: float = 0.30
    frontal_area_m2: float = 2.4
    rolling_resistance: float = 0.012
    powertrain_efficiency: float = 0.88
    air_density_kgpm3: float = 1.225
    gravity_mps2: float = 9.81

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive, got {value}")
        if self.powertrain_efficiency > 1:
            raise ValueError("powertrain_efficiency must be at most 1")

    @property
    def rolling_force_n(self) -> float:
        """Rolling resistance m g f_r, N."""
        return self.mass_kg * self.gravity_mps2 * self.rolling_resistance

    def drag_force_n(self, speed_mps: float, drag_reduction: float = ETA_ALONE) -> float:
        """Aerodynamic drag ½ρC_d(1−η)A v², N."""
        area = self.drag_coefficient * self.frontal_area_m2
        return 0.5 * self.air_density_kgpm3 * area * (1 - drag_reduction) * speed_mps**2


PAPER_CAR = VehicleParameters()


class Energy(NamedTuple):
    """Electrical traction energy in kWh and the forces that it went into; the parts add up."""

    total_kwh: float
    rolling_kwh: float
    drag_kwh: float
    acceleration_kwh: float


def wheel_power_w(
    speed_mps: npt.ArrayLike,
    acceleration_mps2: npt.ArrayLike,
    drag_reduction: npt.ArrayLike = ETA_ALONE,
    vehicle: VehicleParameters = PAPER_CAR,
) -> Array:
    """Tractive power at the wheels, W, negative power set to zero (paper eq. 1).

    Args:
        speed_mps: v, any shape.
        acceleration_mps2: a, same shape.
        drag_reduction: η_drag in [0, 1), broadcast.
    """
    v = np.asarray(speed_mps, dtype=np.float64)
    a = np.asarray(acceleration_mps2, dtype=np.float64)
    eta = np.asarray(drag_reduction, dtype=np.float64)
    drag = vehicle.drag_force_n(1.0) * (1 - eta) * v**2
    return np.maximum(0.0, (vehicle.mass_kg * a + vehicle.rolling_force_n + drag) * v)


def trace_energy(
    speed_mps: npt.ArrayLike,
    step_s: float,
    drag_reduction: npt.ArrayLike = ETA_ALONE,
    vehicle: VehicleParameters = PAPER_CAR,
) -> Energy:
    """Electrical energy of a sampled drive (paper eq. 2), mid-step speed and a = Δv/Δt.

    In a step where traction is needed, rolling and drag take their own work and acceleration the
    rest (less than nothing where the vehicle slows: kinetic energy then pays for part of them).

    Args:
        speed_mps: speeds at the sample times, shape (n,), n ≥ 2.
        step_s: time between samples, s.
        drag_reduction: η_drag in each of the n − 1 steps, or one for all.
    """
    v = np.asarray(speed_mps, dtype=np.float64)
    mid = 0.5 * (v[1:] + v[:-1])
    a = np.diff(v) / step_s
    eta = np.broadcast_to(np.asarray(drag_reduction, dtype=np.float64), mid.shape)
    power = wheel_power_w(mid, a, eta, vehicle)
    drag = vehicle.drag_force_n(1.0) * (1 - eta) * mid**3
    rolling = vehicle.rolling_force_n * mid
    pulling = power > 0
    to_kwh = step_s / (JOULE_PER_KWH * vehicle.powertrain_efficiency)
    total = float(power.sum()) * to_kwh
    rolling_kwh = float(rolling[pulling].sum()) * to_kwh
    drag_kwh = float(drag[pulling].sum()) * to_kwh
    return Energy(total, rolling_kwh, drag_kwh, total - rolling_kwh - drag_kwh)


def steady_energy_kwh(
    distance_m: float,
    speed_mps: float,
    drag_reduction: float = ETA_ALONE,
    mean_acceleration_mps2: float = 0.0,
    vehicle: VehicleParameters = PAPER_CAR,
) -> float:
    """Energy to drive a distance at one speed, kWh: the paper's travel cost c_ij (III-C)."""
    force = (
        vehicle.mass_kg * mean_acceleration_mps2
        + vehicle.rolling_force_n
        + vehicle.drag_force_n(speed_mps, drag_reduction)
    )
    return max(0.0, force) * distance_m / (JOULE_PER_KWH * vehicle.powertrain_efficiency)


def drag_saving_kwh(
    distance_m: float,
    speed_mps: float,
    drag_reduction: float,
    vehicle: VehicleParameters = PAPER_CAR,
) -> float:
    """Energy that a drag reduction η saves over a distance, kWh (the paper's s_{e,k,l})."""
    force = vehicle.drag_force_n(speed_mps) - vehicle.drag_force_n(speed_mps, drag_reduction)
    return force * distance_m / (JOULE_PER_KWH * vehicle.powertrain_efficiency)
