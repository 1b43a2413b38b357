"""Growth of a resource over a soak.

Memory grows if all three of these hold:

- The 95 % interval of its slope (`slipstream_lab.benchmarks.perception.slope`) lies above zero.
- It is relevant: more than 5 MB and more than 2 % of the median in ten minutes, or in the whole
  period where that is longer, and at least 2 MB measured, not extrapolated.
- It continues: the median rises from the first third to the second and from the second to the last.
  A single step, however high, is no leak.

On simulated five-minute soaks (200 seeds; correlated noise of 0.5 MB, teeth of 4 MB) that gives at
most 1 % false alarms, and finds a leak of twice the limit in every one. Descriptors and threads are
counts with short peaks on top: they grow if their least value rises from third to third.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from slipstream_lab.benchmarks.perception.slope import MIN_VALUES, Slope, slope

LIMIT_MB: Final = 5.0
LIMIT_SHARE: Final = 0.02
LIMIT_PERIOD_S: Final = 600.0
MIN_RISE_MB: Final = 2.0
_CONTINUED_SHARE: Final = 0.25


@dataclass(frozen=True)
class Trend:
    """How a series develops; no slope of counts, and of fewer than `MIN_VALUES`."""

    start: float
    end: float
    median: float
    largest: float
    slope: Slope | None
    growing: bool


def memory_trend(times_s: npt.ArrayLike, mb: npt.ArrayLike) -> Trend:
    """Judge resident memory, MB, at ascending times; both of shape (n,), n ≥ 1."""
    times, values = np.asarray(times_s, dtype=np.float64), np.asarray(mb, dtype=np.float64)
    if len(values) < MIN_VALUES:
        return _trend(values, None, False)
    found = slope(times, values)
    rise_mb = found.per_h / 3600 * float(times[-1] - times[0])
    period_s = max(LIMIT_PERIOD_S, float(times[-1] - times[0]))
    least_mb = max(LIMIT_MB, LIMIT_SHARE * float(np.median(values)))
    relevant = found.per_h / 3600 * period_s > least_mb and rise_mb > MIN_RISE_MB
    thirds = [float(np.median(third)) for third in np.array_split(values, 3)]
    continues = all(b - a > _CONTINUED_SHARE * rise_mb / 3 for a, b in pairwise(thirds))
    return _trend(values, found, found.is_growth and relevant and continues)


def count_trend(counts: npt.ArrayLike) -> Trend:
    """Judge descriptors or threads, shape (n,)."""
    values = np.asarray(counts, dtype=np.float64)
    floors = [float(third.min()) for third in np.array_split(values, 3) if len(third)]
    growing = len(floors) == 3 and floors[0] < floors[1] < floors[2]
    return _trend(values, None, growing)


def _trend(values: npt.NDArray[np.float64], found: Slope | None, growing: bool) -> Trend:
    return Trend(
        float(values[0]),
        float(values[-1]),
        float(np.median(values)),
        float(values.max()),
        found,
        growing,
    )
