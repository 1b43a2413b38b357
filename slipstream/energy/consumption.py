"""Physics of traction: wheel power, drag reduction in platoons, electrical energy and its parts.

Formulas: paper section II. The paper excludes regeneration, so energies are gross traction demand
unless a vehicle has a `recuperation_efficiency`.
Everything takes arrays: a trajectory, a stack of them, or all phases of many plans at once.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from slipstream.energy.drive import Drive
from slipstream.energy.traction import (
    ETA_ALONE,
    ETA_FOLLOWER,
    ETA_LEADER,
    JOULE_PER_KWH,
    PAPER_CAR,
    VehicleParameters,
    drag_saving_kwh,
    steady_energy_kwh,
    stop_energy_kwh,
)

__all__ = [
    "ETA_ALONE",
    "ETA_FOLLOWER",
    "ETA_LEADER",
    "JOULE_PER_KWH",
    "PAPER_CAR",
    "Energies",
    "Energy",
    "Saving",
    "VehicleParameters",
    "drag_saving_kwh",
    "drive_energies",
    "drive_energy_kwh",
    "phase_energies",
    "segment_energies",
    "split_saving",
    "stack_traces",
    "steady_energy_kwh",
    "stop_energy_kwh",
    "total",
    "trace_energies",
    "trace_energy",
    "wheel_power_w",
]

Array = npt.NDArray[np.float64]


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


def drive_energies(
    drives: Sequence[Drive],
    drag_reductions: Sequence[Sequence[float]],
    vehicle: VehicleParameters = PAPER_CAR,
) -> Energies:
    """E_physical of many drives at once (paper eq. 2), exactly: their phases need no sampling.

    Args:
        drag_reductions: η_drag on each segment of each drive.

    Returns:
        Arrays of shape (drives,).
    """
    counts = [len(reductions) for reductions in drag_reductions]
    drive_of = np.repeat(np.arange(len(drives)), counts)
    segment, phases = _phases(drives, drag_reductions)
    return _summed(phases, drive_of[segment], len(drives), vehicle)


def segment_energies(
    drives: Sequence[Drive],
    drag_reductions: Sequence[Sequence[float]],
    vehicle: VehicleParameters = PAPER_CAR,
) -> Energies:
    """`drive_energies` of each segment apart.

    Returns:
        Arrays of shape (segments of all drives,), drive after drive.
    """
    count = sum(len(reductions) for reductions in drag_reductions)
    segment, phases = _phases(drives, drag_reductions)
    return _summed(phases, segment, count, vehicle)


def _phases(
    drives: Sequence[Drive], drag_reductions: Sequence[Sequence[float]]
) -> tuple[npt.NDArray[np.int64], Array]:
    """Phases of drives as rows (v₀, v₁, duration, η_drag), and the segment that each belongs to,
    counted over all drives.
    """
    owner: list[int] = []
    phases: list[tuple[float, float, float, float]] = []
    first = 0
    for drive, reductions in zip(drives, drag_reductions, strict=True):
        entry_s = drive.unhindered_s() if drive.waiting_s else drive.entry_s
        for (begin_s, end_s), (v0, v1) in zip(
            pairwise(drive.times_s), pairwise(drive.speeds_mps), strict=True
        ):
            segment = bisect_right(entry_s, 0.5 * (begin_s + end_s)) - 1
            phases.append((v0, v1, end_s - begin_s, reductions[segment]))
            owner.append(first + segment)
        first += len(reductions)
    return np.array(owner, dtype=np.int64), np.array(phases, dtype=np.float64).reshape(-1, 4)


def _summed(
    phases: Array, owner: npt.NDArray[np.int64], count: int, vehicle: VehicleParameters
) -> Energies:
    start, end, seconds, eta = phases.T
    return Energies(
        *(
            np.bincount(owner, weights=part, minlength=count).astype(np.float64)
            for part in phase_energies(start, end, seconds, eta, vehicle)
        )
    )


def drive_energy_kwh(drive: Drive, vehicle: VehicleParameters = PAPER_CAR) -> float:
    """`drive_energies` of one drive without drafting."""
    return drive_energies([drive], [[ETA_ALONE] * len(drive.entry_s)], vehicle).sum().total_kwh
