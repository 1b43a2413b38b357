"""Energy losses of a drive: rolling, drag, and braking by occasion."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from slipstream.energy.consumption import PAPER_CAR, VehicleParameters
from slipstream.energy.drive import Drive

_STANDING_MPS: Final = 0.1
_REGAINED_MPS: Final = 1.0
"""Speed has to rise by so much before what was braking ends; advice makes speeds ripple."""

_SAMPLE_S: Final = 0.5


class Losses(NamedTuple):
    """Electrical energy in kWh of a drive alone, from rest to rest, by what it was lost to.

    The parts add up to its traction energy: from rest to rest nothing stays kinetic. What braking
    gives back is lost to nothing.

    Attributes:
        stands_kwh: braked away before standing on the road: at signals, and behind others.
        slowing_kwh: braked away without coming to a stand: for turns, lower limits, and others.
    """

    rolling_kwh: float
    drag_kwh: float
    arrival_kwh: float
    stands_kwh: float
    slowing_kwh: float


def losses(
    speed_mps: npt.ArrayLike, step_s: npt.ArrayLike, vehicle: VehicleParameters = PAPER_CAR
) -> Losses:
    """Split the energy of a sampled drive, mid-step speed and a = Δv/Δt as in `trace_energies`.

    What is braked away in a step is the negative part of the power at the wheels. It belongs to
    the occasion that the braking ends with: the leg's end, a stand, or neither.

    Args:
        speed_mps: speeds at the sample times, shape (n,), 0 at both ends.
        step_s: time between samples, broadcast to (n − 1,).
    """
    v = np.asarray(speed_mps, dtype=np.float64)
    mid, seconds = 0.5 * (v[1:] + v[:-1]), np.broadcast_to(step_s, len(v) - 1)
    drag_n = vehicle.drag_factor_kgpm * mid**2
    force_n = vehicle.mass_kg * np.diff(v) / seconds + vehicle.rolling_force_n + drag_n
    factor = vehicle.electrical_kwh(1.0)
    lost = factor - vehicle.recovered_kwh(1.0)
    braked_kwh = lost * np.maximum(0.0, -force_n) * mid * seconds
    parts = {"arrival": 0.0, "stand": 0.0, "slowing": 0.0}
    lowest, pending = 0.0, 0.0
    for after_mps, lost_kwh in zip(v[1:].tolist(), braked_kwh.tolist(), strict=True):
        if after_mps > lowest + _REGAINED_MPS:
            parts["stand" if lowest < _STANDING_MPS else "slowing"] += pending
            lowest, pending = after_mps, 0.0
        lowest = min(lowest, after_mps)
        pending += lost_kwh
    parts["arrival"] += pending
    return Losses(
        factor * vehicle.rolling_force_n * float((mid * seconds).sum()),
        factor * float((drag_n * mid * seconds).sum()),
        parts["arrival"],
        parts["stand"],
        parts["slowing"],
    )


def drive_losses(drive: Drive, vehicle: VehicleParameters = PAPER_CAR) -> Losses:
    """The same of a planned drive, sampled twice a second and where its acceleration changes."""
    times = np.union1d(drive.times_s, np.arange(0.0, drive.duration_s, _SAMPLE_S))
    speeds = np.interp(times, drive.times_s, drive.speeds_mps)
    return losses(speeds, np.diff(times), vehicle)
