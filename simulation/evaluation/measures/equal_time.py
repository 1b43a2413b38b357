"""What the baseline would have needed in the same travel time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import isotonic_regression


@dataclass(frozen=True)
class EqualTime:
    """A comparison at equal travel time.

    Attributes:
        energy: the baseline's at this travel time, in the unit of the curve.
        extrapolated: "" within the curve; "slower" or "faster" where the travel time lies beyond
            the slowest or the fastest baseline that was simulated.
    """

    energy: float
    extrapolated: str


class TimeCurve:
    """Energy over travel time of a baseline driven at several paces.

    Driving slower never needs more: measured energies are made to fall with the time (least
    squares under that order), then interpolated by a monotone cubic. Beyond the ends the curve
    is what flatters the baseline: on the slow side it goes on falling as between its last two
    points, on the fast side it stays at its first one.

    Args:
        times: travel time of each pace, any order.
        energies: in the same order.

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
        self._times, self._energies = at, falling
        self._curve = PchipInterpolator(at, falling)

    def at(self, time: float) -> EqualTime:
        """The baseline's energy at a travel time."""
        first, last = float(self._times[0]), float(self._times[-1])
        if time > last:
            step = self._times[-1] - self._times[-2]
            slope = (self._energies[-1] - self._energies[-2]) / step
            return EqualTime(float(self._energies[-1] + slope * (time - last)), "slower")
        if time < first:
            return EqualTime(float(self._energies[0]), "faster")
        return EqualTime(float(self._curve(time)), "")
