"""Physics of traction: wheel power, drag reduction in platoons, electrical energy and its parts.

Formulas: paper section II. The paper excludes regeneration, so energies are gross traction demand
unless a vehicle has a `recuperation_efficiency`.
Everything takes arrays: a trajectory, a stack of them, or all phases of many plans at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field

Array = npt.NDArray[np.float64]

JOULE_PER_KWH = 3.6e6
ETA_ALONE = 0.0
ETA_LEADER = 0.05
ETA_FOLLOWER = 0.20

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
            if not (np.isfinite(value) and positive):
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

    def drag_force_n(self, speed_mps: float, drag_reduction: float = ETA_ALONE) -> float:
        """Aerodynamic drag ½ρC_d(1−η)A v², N."""
        return self.drag_factor_kgpm * (1 - drag_reduction) * speed_mps**2

    def electrical_kwh(self, work_j: float) -> float:
        """Electrical energy for mechanical work at the wheels, kWh."""
        return work_j / (JOULE_PER_KWH * self.powertrain_efficiency)

    def recovered_kwh(self, work_j: float) -> float:
        """Electrical energy that braking work at the wheels, ≥ 0, gives back, kWh."""
        return work_j * self.recuperation_efficiency / JOULE_PER_KWH


PAPER_CAR = VehicleParameters()


class Energy(NamedTuple):
    """Electrical traction energy in kWh and the forces that it went into; the parts add up."""

    total_kwh: float
    rolling_kwh: float
    drag_kwh: float
    acceleration_kwh: float


class Energies(NamedTuple):
    """`Energy` of many trajectories: arrays of one shape, kWh."""

    total_kwh: Array
    rolling_kwh: Array
    drag_kwh: Array
    acceleration_kwh: Array

    def sum(self) -> Energy:
        """Of all of them together: a plan's energy from its phases', a fleet's from its plans'."""
        return Energy(*(float(part.sum()) for part in self))


class Saving(NamedTuple):
    """Saving of one set of drives against another, kWh; the parts add up."""

    total_kwh: float
    distance_kwh: float
    drag_kwh: float
    acceleration_kwh: float


def total(energies: Iterable[Energy]) -> Energy:
    """Sum of energies; zero of none."""
    parts = np.array([*energies], dtype=np.float64).reshape(-1, len(Energy._fields))
    return Energies(*parts.T).sum()


def split_saving(baseline: Energy, undrafted: Energy, driven: Energy) -> Saving:
    """Split a saving by its causes (paper section II-C has only the total).

    - drag: what drafting saves, the same drive with and without it;
    - acceleration: the difference of the undrafted drives in energy for speed changes;
    - distance: their difference in rolling resistance and undrafted drag: how far, how fast.

    Args:
        baseline: the drives compared with, every vehicle alone.
        undrafted: our drives without drag reductions.
        driven: our drives with their drag reductions.
    """
    return Saving(
        baseline.total_kwh - driven.total_kwh,
        baseline.rolling_kwh + baseline.drag_kwh - undrafted.rolling_kwh - undrafted.drag_kwh,
        undrafted.total_kwh - driven.total_kwh,
        baseline.acceleration_kwh - undrafted.acceleration_kwh,
    )


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
    return np.maximum(0.0, _signed_power_w(v, a, eta, vehicle))


def _braking_power_w(
    speed_mps: Array, acceleration_mps2: Array, drag_reduction: Array, vehicle: VehicleParameters
) -> Array:
    """What brakes or motor take from the wheels, W, ≥ 0."""
    return np.maximum(0.0, -_signed_power_w(speed_mps, acceleration_mps2, drag_reduction, vehicle))


def _signed_power_w(v: Array, a: Array, eta: Array, vehicle: VehicleParameters) -> Array:
    drag = vehicle.drag_factor_kgpm * (1 - eta) * v**2
    return np.asarray((vehicle.mass_kg * a + vehicle.rolling_force_n + drag) * v)


def stack_traces(traces: Sequence[npt.ArrayLike]) -> Array:
    """Trajectories of different lengths as rows of one array for `trace_energies`.

    Args:
        traces: speeds at the sample times, each of shape (n_i,).

    Returns:
        Shape (traces, longest n_i), short rows filled up with NaN.
    """
    rows = [np.asarray(trace, dtype=np.float64) for trace in traces]
    stack = np.full((len(rows), max((len(row) for row in rows), default=0)), np.nan)
    for row, filled in zip(rows, stack, strict=True):
        filled[: len(row)] = row
    return stack


def trace_energies(
    speed_mps: npt.ArrayLike,
    step_s: npt.ArrayLike,
    drag_reduction: npt.ArrayLike = ETA_ALONE,
    vehicle: VehicleParameters = PAPER_CAR,
) -> Energies:
    """Electrical energy of sampled drives (paper eq. 2), mid-step speed and a = Δv/Δt.

    In a step where traction is needed, rolling and drag take their own work and acceleration the
    rest (less than nothing where the vehicle slows: kinetic energy then pays for part of them).
    Recuperated energy is taken off the part of acceleration.

    Args:
        speed_mps: speeds at the sample times, shape (..., n); a step next to a NaN counts nothing.
        step_s: time between samples, broadcast to (..., n − 1).
        drag_reduction: η_drag in each step, broadcast to (..., n − 1).

    Returns:
        Arrays of shape (...).
    """
    v = np.asarray(speed_mps, dtype=np.float64)
    seconds = np.asarray(step_s, dtype=np.float64)
    mid = 0.5 * (v[..., 1:] + v[..., :-1])
    a = np.diff(v, axis=-1) / seconds
    eta = np.broadcast_to(np.asarray(drag_reduction, dtype=np.float64), mid.shape)
    power = np.nan_to_num(wheel_power_w(mid, a, eta, vehicle), nan=0.0)
    pulling_s = np.where(power > 0, seconds, 0.0)
    moving = np.nan_to_num(mid, nan=0.0)
    factor = vehicle.electrical_kwh(1.0)
    energy = (power * seconds).sum(axis=-1) * factor
    rolling = vehicle.rolling_force_n * (moving * pulling_s).sum(axis=-1) * factor
    drag = vehicle.drag_factor_kgpm * ((1 - eta) * moving**3 * pulling_s).sum(axis=-1) * factor
    if vehicle.recuperation_efficiency > 0:
        braking = np.nan_to_num(_braking_power_w(mid, a, eta, vehicle), nan=0.0)
        energy = energy - (braking * seconds).sum(axis=-1) * vehicle.recovered_kwh(1.0)
    return Energies(energy, rolling, drag, energy - rolling - drag)


def trace_energy(
    speed_mps: npt.ArrayLike,
    step_s: float,
    drag_reduction: npt.ArrayLike = ETA_ALONE,
    vehicle: VehicleParameters = PAPER_CAR,
) -> Energy:
    """`trace_energies` of one trajectory, speeds of shape (n,)."""
    return Energy(*map(float, trace_energies(speed_mps, step_s, drag_reduction, vehicle)))


def phase_energies(
    start_mps: npt.ArrayLike,
    end_mps: npt.ArrayLike,
    duration_s: npt.ArrayLike,
    drag_reduction: npt.ArrayLike = ETA_ALONE,
    vehicle: VehicleParameters = PAPER_CAR,
) -> Energies:
    """Paper eq. 2 without sampling, for phases in which speed changes linearly with time.

    Traction is needed from the speed upwards at which drag, rolling resistance and inertia cancel,
    so each phase is one integral over a range of speeds: ∫v dt and ∫v³ dt are (v₁² − v₀²)/2a and
    (v₁⁴ − v₀⁴)/4a. Below that speed the vehicle brakes, and what it recuperates is taken off the
    part of acceleration.

    Args:
        start_mps: speeds at the begin of the phases, any shape.
        end_mps: speeds at their end, same shape.
        duration_s: their durations, same shape; 0 counts nothing.
        drag_reduction: η_drag, broadcast.

    Returns:
        Arrays of that shape.
    """
    v0, v1, seconds, eta = np.broadcast_arrays(
        *(np.asarray(x, dtype=np.float64) for x in (start_mps, end_mps, duration_s, drag_reduction))
    )
    lasting = np.where(seconds > 0, seconds, 1.0)
    a = np.where(seconds > 0, v1 - v0, 0.0) / lasting
    drag_factor = vehicle.drag_factor_kgpm * (1 - eta)
    braking_n = -(vehicle.mass_kg * a + vehicle.rolling_force_n)
    least = np.sqrt(np.maximum(0.0, braking_n) / drag_factor)
    low = np.minimum(np.maximum(np.minimum(v0, v1), least), np.maximum(v0, v1))
    high = np.maximum(v0, v1)
    # The share of the phase above that speed; all of a phase at one speed, which needs traction.
    span = np.abs(v1 - v0)
    share = np.where(span > 0, (high - low) / np.where(span > 0, span, 1.0), 1.0)
    pulling_s = np.where(seconds > 0, share * seconds, 0.0)
    distance = 0.5 * (low + high) * pulling_s
    cubed = 0.25 * (low + high) * (low**2 + high**2) * pulling_s
    factor = vehicle.electrical_kwh(1.0)
    rolling = vehicle.rolling_force_n * distance * factor
    drag = drag_factor * cubed * factor
    acceleration = vehicle.mass_kg * a * distance * factor
    if vehicle.recuperation_efficiency > 0:
        slowest = np.minimum(v0, v1)
        braking_s = np.where(seconds > 0, (1 - share) * seconds, 0.0)
        braking_m = 0.5 * (slowest + low) * braking_s
        cubed_below = 0.25 * (slowest + low) * (slowest**2 + low**2) * braking_s
        work_j = braking_n * braking_m - drag_factor * cubed_below
        acceleration = acceleration - np.maximum(0.0, work_j) * vehicle.recovered_kwh(1.0)
    return Energies(rolling + drag + acceleration, rolling, drag, acceleration)


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


def stop_energy_kwh(speed_mps: float, vehicle: VehicleParameters = PAPER_CAR) -> float:
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
