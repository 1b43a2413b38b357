"""Physics of a vehicle in single numbers: its data, and what a distance, a stop, a draft are worth.

Formulas: paper section II. `consumption` has the same for arrays. Nothing here needs numpy,
which would double an agent's memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeVar

from pydantic import ConfigDict, Field

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

JOULE_PER_KWH = 3.6e6
ETA_ALONE = 0.0
ETA_LEADER = 0.05
ETA_FOLLOWER = 0.20

Quantity = TypeVar("Quantity", float, "npt.NDArray[np.float64]")
"""A number or an array of them."""
_Positive = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]


@dataclass(frozen=True)
class VehicleParameters:
    """A vehicle's physical data; the paper's electric car is the default (section II-A).

    Attributes:
        mass_kg: m.
        drag_coefficient: C_d, dimensionless.
        frontal_area_m2: A.
        rolling_resistance: f_r, dimensionless.
        powertrain_efficiency: η_elec, in (0, 1].
        recuperation_efficiency: share of the braking work at the wheels that comes back into the
            battery, in [0, 1]; the paper's 0: none.
        air_density_kgpm3: ρ.
        gravity_mps2: g.
    """

    # Where files give it, as part of a settings model.
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    mass_kg: _Positive = 1800.0
    drag_coefficient: _Positive = 0.30
    frontal_area_m2: _Positive = 2.4
    rolling_resistance: _Positive = 0.012
    powertrain_efficiency: Annotated[_Positive, Field(le=1)] = 0.88
    air_density_kgpm3: _Positive = 1.225
    gravity_mps2: _Positive = 9.81
    recuperation_efficiency: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.recuperation_efficiency <= 1:
            raise ValueError(
                f"recuperation_efficiency must be in [0, 1], got {self.recuperation_efficiency}"
            )
        for name, value in vars(self).items():
            positive = value > 0 or name == "recuperation_efficiency"
            if not (math.isfinite(value) and positive):
                raise ValueError(f"{name} must be positive, got {value}")
        if self.powertrain_efficiency > 1:
            raise ValueError("powertrain_efficiency must be at most 1")

    @property
    def rolling_force_n(self) -> float:
        """Rolling resistance m g f_r, N."""
        return self.mass_kg * self.gravity_mps2 * self.rolling_resistance

    @property
    def drag_factor_kgpm(self) -> float:
        """½ρC_dA: drag force over speed squared, kg/m."""
        return 0.5 * self.air_density_kgpm3 * self.drag_coefficient * self.frontal_area_m2

    def drag_force_n(self, speed_mps: Quantity, drag_reduction: float = ETA_ALONE) -> Quantity:
        """Aerodynamic drag ½ρC_d(1−η)A v², N."""
        return self.drag_factor_kgpm * (1 - drag_reduction) * speed_mps**2

    def electrical_kwh(self, work_j: Quantity) -> Quantity:
        """Electrical energy for mechanical work at the wheels, kWh."""
        return work_j / (JOULE_PER_KWH * self.powertrain_efficiency)

    def recovered_kwh(self, work_j: Quantity) -> Quantity:
        """Electrical energy that braking work at the wheels, ≥ 0, gives back, kWh."""
        return work_j * self.recuperation_efficiency / JOULE_PER_KWH


PAPER_CAR = VehicleParameters()


def coasting_mps2(speed_mps: float, vehicle: VehicleParameters) -> float:
    """Deceleration without traction and brake, m/s²."""
    return (vehicle.rolling_force_n + vehicle.drag_force_n(speed_mps)) / vehicle.mass_kg


def steady_energy_kwh(
    distance_m: float,
    speed_mps: float,
    drag_reduction: float = ETA_ALONE,
    mean_acceleration_mps2: float = 0.0,
    vehicle: VehicleParameters = PAPER_CAR,
) -> float:
    """Energy to drive a distance at one speed, kWh: the paper's travel cost c_ij (III-C); below 0
    where a mean deceleration recuperates.
    """
    force = (
        vehicle.mass_kg * mean_acceleration_mps2
        + vehicle.rolling_force_n
        + vehicle.drag_force_n(speed_mps, drag_reduction)
    )
    if force < 0:
        return -vehicle.recovered_kwh(-force * distance_m)
    return vehicle.electrical_kwh(force * distance_m)


def stop_energy_kwh(speed_mps: Quantity, vehicle: VehicleParameters = PAPER_CAR) -> Quantity:
    """Energy of one full stop, kWh: the lost kinetic energy ½mv² over η_elec, without what braking
    recuperates of it.
    """
    kinetic_j = 0.5 * vehicle.mass_kg * speed_mps**2
    return vehicle.electrical_kwh(kinetic_j) - vehicle.recovered_kwh(kinetic_j)


def drag_saving_kwh(
    distance_m: float,
    speed_mps: float,
    drag_reduction: float,
    vehicle: VehicleParameters = PAPER_CAR,
) -> float:
    """Energy that a drag reduction η saves over a distance, kWh (the paper's s_{e,k,l})."""
    force = vehicle.drag_force_n(speed_mps) - vehicle.drag_force_n(speed_mps, drag_reduction)
    return vehicle.electrical_kwh(force * distance_m)
