"""What the baseline would have needed in the same travel time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import isotonic_regression


class TimeCurve:
    """Energy over travel time of a baseline driven at several paces.

    Driving slower never needs more: measured energies are made to fall with the time (least
    squares under that order), then interpolated by a monotone cubic. Beyond its ends there is no
    curve: what the baseline would need there was not simulated.

    Raises:
        ValueError: fewer than two different travel times.
    """

    def __init__(self, times: Sequence[float], energies: Sequence[float]) -> None:
        at, where = np.unique(np.asarray(times, dtype=np.float64), return_inverse=True)
        if len(at) < 2:
            raise ValueError("a curve needs two different travel times")
        count = np.bincount(where)
        mean = np.bincount(where, weights=np.asarray(energies, dtype=np.float64)) / count
        falling = isotonic_regression(mean, weights=count, increasing=False).x
        self.fastest, self.slowest = float(at[0]), float(at[-1])
        self._curve = PchipInterpolator(at, falling)

    def at(self, time: float) -> float | None:
        """The baseline's energy at a travel time; None beyond the ends."""
        if not self.fastest <= time <= self.slowest:
            return None
        return float(self._curve(time))
