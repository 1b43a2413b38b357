"""Growth test for resource series of a soak.

Resident memory is neither independent from second to second nor normal: it steps when an allocator
takes another arena, has the teeth of the dispatch cycle, and settles for a while after the start.
A series grows if all three of these hold:

- The slope is significant: the Theil-Sen slope (median over all pairs of points, which a
  third of outliers cannot move; Sen 1968) has a 95 % interval above zero. The interval comes from
  a moving-block bootstrap of the residuals (Künsch 1989), whose blocks are longer than a cycle.
- It is relevant: more than 5 MB and more than 2 % of the median in ten minutes, or in the whole
  period where that is longer, and at least 2 MB measured, not extrapolated.
- It continues: the median rises from the first third to the second and from the second to the last.
  A single step, however high, is no leak; one that is repeated less than once a third cannot be
  distinguished from it; that needs a longer soak.

On simulated five-minute soaks (300 seeds; correlated noise of 0.5 MB, teeth of 4 MB) that gives at
most 0.3 % false alarms, and finds a leak of twice the limit in 93 to 100 %.

Descriptors and threads are counts with short peaks on top, so their floor is judged: growing is
when the least value rises from third to third.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

LIMIT_MB: Final = 5.0
LIMIT_SHARE: Final = 0.02
LIMIT_PERIOD_S: Final = 600.0
MIN_RISE_MB: Final = 2.0
_MAX_BINS: Final = 120
_MIN_BIN_S: Final = 5.0
_BLOCK_S: Final = 40.0
_RESAMPLES: Final = 400
_CONTINUED_SHARE: Final = 0.25

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trend:
    """How a series develops.

    Attributes:
        low_per_h, high_per_h: its 95 % confidence interval; None for counts.
    """

    start: float
    end: float
    median: float
    largest: float
    slope_per_h: float
    low_per_h: float | None
    high_per_h: float | None
    growing: bool


def memory_trend(times_s: npt.ArrayLike, mb: npt.ArrayLike, seed: int = 1) -> Trend:
    """Judge resident memory.

    Args:
        times_s: ascending, shape (n,), n ≥ 1.
        mb: memory in MB, shape (n,).
    """
    times, values = _arrays(times_s, mb)
    x, y = _binned(times, values)
    slope = theil_sen(x, y)
    low, high = _interval(x, y, slope, np.random.default_rng(seed))
    window_s = float(x[-1] - x[0])
    period_s = max(LIMIT_PERIOD_S, window_s)
    relevant = (
        slope * period_s > max(LIMIT_MB, LIMIT_SHARE * float(np.median(values)))
        and slope * window_s > MIN_RISE_MB
    )
    steps = np.diff([float(np.median(third)) for third in np.array_split(y, 3) if len(third)])
    continues = len(steps) == 2 and bool((steps > _CONTINUED_SHARE * slope * window_s / 3).all())
    return _trend(values, slope, low, high, low > 0 and relevant and continues)


def count_trend(times_s: npt.ArrayLike, counts: npt.ArrayLike) -> Trend:
    """Judge a number of descriptors or threads; arguments as for `memory_trend`."""
    times, values = _arrays(times_s, counts)
    x, y = _binned(times, values)
    floors = [float(third.min()) for third in np.array_split(values, 3) if len(third)]
    growing = len(floors) == 3 and floors[0] < floors[1] < floors[2]
    return _trend(values, theil_sen(x, y), None, None, growing)


def theil_sen(x: Array, y: Array) -> float:
    """Median slope over all pairs of points; 0 for a single point."""
    return float(_slopes(x, y[None])[0])


def _arrays(times_s: npt.ArrayLike, values: npt.ArrayLike) -> tuple[Array, Array]:
    return np.asarray(times_s, dtype=np.float64), np.asarray(values, dtype=np.float64)


def _trend(
    values: Array, slope_per_s: float, low: float | None, high: float | None, growing: bool
) -> Trend:
    return Trend(
        start=float(values[0]),
        end=float(values[-1]),
        median=float(np.median(values)),
        largest=float(values.max()),
        slope_per_h=3600 * slope_per_s,
        low_per_h=None if low is None else 3600 * low,
        high_per_h=None if high is None else 3600 * high,
        growing=growing,
    )


def _binned(times: Array, values: Array) -> tuple[Array, Array]:
    """Medians over bins of 5 s or more, few enough for all their pairs to be compared."""
    span = float(times[-1] - times[0])
    width = max(_MIN_BIN_S, span / _MAX_BINS) if span > 10 * _MIN_BIN_S else span / 10
    if width <= 0:
        return times[:1], values[:1]
    number = np.floor((times - times[0]) / width).astype(int)
    bins = np.unique(number)
    x = np.array([times[number == b].mean() for b in bins])
    y = np.array([np.median(values[number == b]) for b in bins])
    return x, y


def _slopes(x: Array, series: Array) -> Array:
    """Theil-Sen slope of each row of ``series``, shape (rows, n) to (rows,)."""
    if len(x) < 2:
        return np.zeros(len(series))
    i, j = np.triu_indices(len(x), 1)
    result: Array = np.median((series[:, j] - series[:, i]) / (x[j] - x[i]), axis=1)
    return result


def _interval(x: Array, y: Array, slope: float, rng: np.random.Generator) -> tuple[float, float]:
    """95 % confidence interval of the slope, from a moving-block bootstrap of the residuals."""
    n = len(x)
    if n < 3:
        return slope, slope
    fitted = slope * x
    residuals = y - fitted
    block = int(np.clip(np.ceil(_BLOCK_S / ((x[-1] - x[0]) / (n - 1))), 1, max(1, n // 3)))
    count = -(-n // block)
    starts = rng.integers(0, n - block + 1, size=(_RESAMPLES, count))
    index = (starts[:, :, None] + np.arange(block)).reshape(_RESAMPLES, -1)[:, :n]
    # In parts: all pairs of all resamples at once would take half a gigabyte.
    slopes = np.concatenate(
        [_slopes(x, fitted + residuals[part]) for part in np.array_split(index, 20)]
    )
    low, high = np.percentile(slopes, (2.5, 97.5))
    return float(low), float(high)
