"""Drive of a vehicle on a leg from rest to rest: speed profile and entry times.

Every leg starts and ends at a standstill (depot or stop), so a leg's drive does not depend on the
legs around it: entry times within it are exact once its departure is known. Of a vehicle that is on
its leg, the rest of it begins at the vehicle's speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise


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
        times_s: break points from the departure, shape (n,), increasing; only 0 for an empty path.
        speeds_mps: speed at each, shape (n,); 0 at the end.
        entry_s: when each segment is entered.
        length_m: driven distance.
        waiting_s: expected delay by traffic and signals on each segment, s;
            not in `times_s`, but in `entry_s`. None: nowhere.
    """

    times_s: tuple[float, ...]
    speeds_mps: tuple[float, ...]
    entry_s: tuple[float, ...]
    length_m: float
    waiting_s: tuple[float, ...] = ()

    @cached_property
    def duration_s(self) -> float:
        """Time from departure to arrival."""
        return self.times_s[-1] + sum(self.waiting_s)

    def delayed(self, waiting_s: Sequence[float]) -> Drive:
        """The same drive with a delay on each segment, s."""
        before = accumulate(waiting_s, initial=0.0)
        entry_s = tuple(at + late for at, late in zip(self.entry_s, before, strict=False))
        return replace(self, entry_s=entry_s, waiting_s=tuple(waiting_s))

    def unhindered_s(self) -> tuple[float, ...]:
        """Entry times of the segments without delays, s."""
        before = accumulate(self.waiting_s, initial=0.0)
        return tuple(at - late for at, late in zip(self.entry_s, before, strict=False))


def plan_drive(
    lengths_m: Sequence[float],
    speeds_mps: Sequence[float],
    style: DrivingStyle,
    begin_mps: float = 0.0,
) -> Drive:
    """Fastest drive to rest that keeps to the segment speeds and the style's rates.

    Speed rises after entering a faster segment and falls before a slower one. A segment that is too
    short for its speed is driven as fast as the rates allow.

    Args:
        lengths_m: length of each segment, > 0, at least one.
        speeds_mps: speed to hold on each, > 0.
        begin_mps: speed at its begin; a lower one counts where it is above the first segment's
            speed, or too high to stop at the end.
    """
    up, down = style.acceleration_mps2, style.braking_mps2
    count = len(lengths_m)
    begin = min(begin_mps, speeds_mps[0])
    node = [begin, *(min(a, b) for a, b in pairwise(speeds_mps)), 0.0]
    for i in range(count):
        node[i + 1] = min(node[i + 1], math.sqrt(node[i] ** 2 + 2 * up * lengths_m[i]))
    for i in reversed(range(count)):
        node[i] = min(node[i], math.sqrt(node[i + 1] ** 2 + 2 * down * lengths_m[i]))

    times, speeds, entries = [0.0], [node[0]], []
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
