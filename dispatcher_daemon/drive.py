"""How a vehicle drives a leg from rest to rest: speed profile, entry times, energy.

Every leg starts and ends at a standstill (depot or stop), so a leg's drive does not depend on the
legs around it: entry times within it are exact once its departure is known.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slipstream.energy import PAPER_CAR, Energy, VehicleParameters, trace_energy

TRACE_STEP_S = 0.1


@dataclass(frozen=True)
class DrivingStyle:
    """Comfortable rates of speed change, m/s², both > 0."""

    acceleration_mps2: float = 1.2
    braking_mps2: float = 1.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive, got {value}")


@dataclass(frozen=True)
class Drive:
    """A speed profile over consecutive segments, linear in time between its break points.

    Attributes:
        times_s: break points from the departure, shape (n,), increasing; only 0 for no way at all.
        speeds_mps: speed at each, shape (n,); 0 at both ends.
        entry_s: when each segment is entered.
        length_m: driven distance.
    """

    times_s: tuple[float, ...]
    speeds_mps: tuple[float, ...]
    entry_s: tuple[float, ...]
    length_m: float

    @property
    def duration_s(self) -> float:
        """Time from departure to arrival."""
        return self.times_s[-1]


def plan_drive(
    lengths_m: Sequence[float], speeds_mps: Sequence[float], style: DrivingStyle
) -> Drive:
    """Fastest drive from rest to rest that keeps to the segment speeds and the style's rates.

    Speed rises after entering a faster segment and falls before a slower one. A segment that is too
    short for its speed is driven as fast as the rates allow.

    Args:
        lengths_m: length of each segment, > 0, at least one.
        speeds_mps: speed to hold on each, > 0.
    """
    up, down = style.acceleration_mps2, style.braking_mps2
    count = len(lengths_m)
    node = [0.0, *(min(a, b) for a, b in pairwise(speeds_mps)), 0.0]
    for i in range(count):
        node[i + 1] = min(node[i + 1], math.sqrt(node[i] ** 2 + 2 * up * lengths_m[i]))
    for i in reversed(range(count)):
        node[i] = min(node[i], math.sqrt(node[i + 1] ** 2 + 2 * down * lengths_m[i]))

    times, speeds, entries = [0.0], [0.0], []
    for i, (length, limit) in enumerate(zip(lengths_m, speeds_mps, strict=True)):
        entries.append(times[-1])
        v0, v1 = node[i], node[i + 1]
        # Where acceleration and braking meet if there is no room to hold a speed between them.
        meeting = math.sqrt((2 * up * down * length + down * v0**2 + up * v1**2) / (up + down))
        peak = max(v0, v1, min(limit, meeting))
        rise, fall = (peak**2 - v0**2) / (2 * up), (peak**2 - v1**2) / (2 * down)
        held_s = max(0.0, length - rise - fall) / peak
        for duration, speed in (((peak - v0) / up, peak), (held_s, peak), ((peak - v1) / down, v1)):
            if duration > 1e-9:
                times.append(times[-1] + duration)
                speeds.append(speed)
    return Drive(tuple(times), tuple(speeds), tuple(entries), float(sum(lengths_m)))


def drive_energy(
    drive: Drive,
    drag_reductions: Sequence[float],
    vehicle: VehicleParameters = PAPER_CAR,
    step_s: float = TRACE_STEP_S,
) -> Energy:
    """E_physical of a drive (paper eq. 2), from a trace sampled at most ``step_s`` apart.

    Args:
        drag_reductions: η_drag on each segment.
    """
    # Phase by phase: a step that straddles pulling and braking would set one against the other.
    parts = []
    phases = zip(pairwise(drive.times_s), pairwise(drive.speeds_mps), strict=True)
    for (begin_s, end_s), (v0, v1) in phases:
        segment = bisect_right(drive.entry_s, 0.5 * (begin_s + end_s)) - 1
        steps = math.ceil((end_s - begin_s) / step_s)
        speeds = np.linspace(v0, v1, steps + 1)
        step = (end_s - begin_s) / steps
        parts.append(trace_energy(speeds, step, drag_reductions[segment], vehicle))
    if not parts:
        return Energy(0.0, 0.0, 0.0, 0.0)
    return Energy(*(sum(values) for values in zip(*parts, strict=True)))
