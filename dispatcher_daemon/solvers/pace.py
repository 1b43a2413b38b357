"""How long samples take on this machine as busy as it is, measured on a few of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

_FEW: Final = 16
_MORE: Final = 128
_LEAST_SLOPE: Final = 0.25
"""Share of the longer trial that is taken to grow with the shots, where noise hides how much."""


@dataclass(frozen=True)
class SolverPace:
    """Time for samples, linear in their number.

    Attributes:
        fixed_s: of any number.
        shot_s: of each.
    """

    fixed_s: float
    shot_s: float

    def time_s(self, shots: int) -> float:
        """Time for so many."""
        return self.fixed_s + shots * self.shot_s

    def shots_in(self, time_s: float, most: int) -> int:
        """As many as fit; a few where nothing does, as these were drawn in the trial too."""
        left_s = time_s - self.fixed_s
        if most * self.shot_s <= left_s:
            return most
        return min(most, max(_FEW, int(left_s / self.shot_s)))


def measure_pace(take: Callable[[int], object], shots: int, enough_s: float) -> SolverPace:
    """Try a few samples, and some more where the few do not show that there is time enough.

    Args:
        take: draws and processes so many.
        shots: that are wanted.
        enough_s: time in which they may all be taken.
    """
    few_s = _timed(take, _FEW)
    if few_s * max(1.0, shots / _FEW) <= enough_s:
        return SolverPace(0.0, few_s / _FEW)
    more_s = _timed(take, _MORE)
    slope = max((more_s - few_s) / (_MORE - _FEW), _LEAST_SLOPE * more_s / _MORE)
    return SolverPace(max(0.0, more_s - slope * _MORE), slope)


def _timed(take: Callable[[int], object], shots: int) -> float:
    began = time.perf_counter()
    take(shots)
    return time.perf_counter() - began
