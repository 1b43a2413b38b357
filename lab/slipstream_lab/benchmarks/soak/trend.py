"""Growth of a resource over a soak.

Of memory the 95 % interval of its slope (`slipstream_lab.benchmarks.perception.slope`) decides:

- steady: it ends below 1 MB an hour, so that a leak of as much or more would have been seen;
- grows: one twice as wide lies above zero, as a soak asks this of some fifteen processes; and the
  median rises from the first third to the second and from the second to the last. A single step,
  however high, is no leak;
- else it cannot be told, and a longer soak has to.

How narrow the interval is depends on how much a process's memory moves, and on the time. Simulated
with correlated noise of 0.1 MB (15 s), 200 seeds each:

| soak, minutes (judged) | 5 (3.3) | 20 (13.3) | 60 (40) |
|---|--:|--:|--:|
| a leak of 60 MB/h is found | 100 % | 100 % | 100 % |
| 20 MB/h | 99 % | 100 % | 100 % |
| 5 MB/h | 32 % | 100 % | 100 % |
| 2 MB/h | 10 % | 91 % | 100 % |
| without a leak: steady, cannot tell, grows | 17, 80, 3 % | 88, 12, 0 % | 100, 0, 0 % |

Descriptors and threads are counts with short peaks on top: they grow if their least value rises
from third to third.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from slipstream_lab.benchmarks.perception.slope import MIN_VALUES, Slope, slope

LIMIT_MB_PER_H: Final = 1.0
Word = Literal["steady", "grows", "cannot tell"]
STEADY: Final = "steady"
GROWS: Final = "grows"
CANNOT_TELL: Final = "cannot tell"
_SURE: Final = 2.0
"""Half-widths of the 95 % interval."""
_CONTINUED_SHARE: Final = 0.25


@dataclass(frozen=True)
class Trend:
    """How a series develops; no slope of counts, and of fewer than `MIN_VALUES`."""

    start: float
    end: float
    median: float
    largest: float
    slope: Slope | None
    word: Word


def memory_trend(times_s: npt.ArrayLike, mb: npt.ArrayLike) -> Trend:
    """Judge memory, MB, at ascending times; both of shape (n,), n ≥ 1."""
    times, values = np.asarray(times_s, dtype=np.float64), np.asarray(mb, dtype=np.float64)
    if len(values) < MIN_VALUES:
        return _trend(values, None, CANNOT_TELL)
    found = slope(times, values)
    rise_mb = found.per_h / 3600 * float(times[-1] - times[0])
    thirds = [float(np.median(third)) for third in np.array_split(values, 3)]
    continues = all(b - a > _CONTINUED_SHARE * rise_mb / 3 for a, b in pairwise(thirds))
    if found.high_per_h < LIMIT_MB_PER_H:
        return _trend(values, found, STEADY)
    is_sure = found.per_h > _SURE * (found.per_h - found.low_per_h)
    return _trend(values, found, GROWS if is_sure and continues else CANNOT_TELL)


def count_trend(counts: npt.ArrayLike) -> Trend:
    """Judge descriptors or threads, shape (n,)."""
    values = np.asarray(counts, dtype=np.float64)
    floors = [float(third.min()) for third in np.array_split(values, 3) if len(third)]
    growing = len(floors) == 3 and floors[0] < floors[1] < floors[2]
    return _trend(values, None, GROWS if growing else STEADY)


def _trend(values: npt.NDArray[np.float64], found: Slope | None, word: Word) -> Trend:
    return Trend(
        float(values[0]),
        float(values[-1]),
        float(np.median(values)),
        float(values.max()),
        found,
        word,
    )
