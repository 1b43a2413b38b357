"""Bins of time for the bound: on each link a clock of its own, so that a trip stays in its bin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from research.coordination.case import Bools, Case, Floats, Ints

_LENGTHS_MS: Final = tuple(
    round(1000 * s) for s in (2, 3, 4, 5, 8, 10, 16, 20, 25, 40, 50, 80, 100, 200, 400)
)
_MAX_BINS: Final = 150
"""Of a trip: with more of them the descent needs more iterations."""
_MAX_CELLS: Final = 1_000_000
"""Greatest number of (trip, link, bin): memory and time grow with it."""


@dataclass(frozen=True)
class Bins:
    """Where each trip can be, by bins of its delay.

    A *pool* is a link and a bin: vehicles that may platoon there behind one that enters in it.

    Attributes:
        length_ms: of a bin.
        ahead: so many bins before its own may the first vehicle of a trip's platoon be.
        delay_ms: least delay in a bin, shape (trips, bins).
        reached: bins that a trip has, same shape.
        pool: number of each trip's pools, shape (links of a trip, trips, bins + ahead): at k those
            of the bin k − ahead; 0 is no pool.
        pools: number of pools, with that of none.
        link: of each pool; −1 of none.
    """

    length_ms: int
    ahead: int
    delay_ms: Floats
    reached: Bools
    pool: Ints
    pools: int
    link: Ints


def choose_bins(case: Case) -> Bins:
    """The shortest bins that fit the driving times and the memory.

    Raises:
        ValueError: none fits: two ways between the same links, say, take times that no multiple of
            a bin lies between.
    """
    longest_ms = int(case.useful_ms.max() + 1)
    at_least_ms = longest_ms * max(1 / _MAX_BINS, int((case.link >= 0).sum()) / _MAX_CELLS)
    for length_ms in _LENGTHS_MS:
        if length_ms >= at_least_ms or length_ms == _LENGTHS_MS[-1]:
            clock = _clocks(case, length_ms)
            if clock is not None:
                return _bins(case, length_ms, clock)
    raise ValueError("no bins fit the driving times")


def _bins(case: Case, length_ms: int, clock: Ints) -> Bins:
    ahead = -(-case.sync_window_ms // length_ms)
    present = case.link >= 0
    at_ms = case.ready_ms[:, None] + case.offset_ms - np.append(clock, 0)[case.link]
    base, phase_ms = np.divmod(at_ms, length_ms)
    count = (phase_ms[:, 0] + case.useful_ms) // length_ms + 1
    numbers = np.arange(int(count.max()))
    reached = numbers < count[:, None]
    delay_ms = np.maximum(numbers * length_ms - phase_ms[:, :1], 0).astype(np.float64)
    low = int(base[present].min()) - ahead
    width = int(base[present].max()) - low + len(numbers) + 1
    in_pool = np.zeros((len(reached), len(numbers) + ahead), dtype=bool)
    for shift in range(ahead + 1):
        in_pool[:, shift : shift + len(numbers)] |= reached
    pool = np.zeros((case.link.shape[1], *in_pool.shape), dtype=np.int64)
    steps = np.arange(-ahead, len(numbers))
    for position, there in enumerate(present.T):
        keys = (case.link[there, position] * width + base[there, position] - low)[:, None] + steps
        pool[position, there] = np.where(in_pool[there], keys, -1) + 1
    used, numbered = np.unique(pool, return_inverse=True)
    if used[0] != 0:
        used, numbered = np.append(0, used), numbered + 1
    link = np.where(used > 0, (used - 1) // width, -1)
    return Bins(length_ms, ahead, delay_ms, reached, numbered.reshape(pool.shape), len(used), link)


def _clocks(case: Case, length_ms: int) -> Ints | None:
    """Begin of each link's bins, ms, such that a trip is at one place in all its bins; None if
    there is none.
    """
    after: dict[int, dict[int, set[int]]] = {}
    for row, times in zip(case.link.tolist(), case.offset_ms.tolist(), strict=True):
        for a, b, at, then in zip(row, row[1:], times, times[1:], strict=False):
            if b >= 0:
                after.setdefault(a, {}).setdefault(b, set()).add(then - at)
                after.setdefault(b, {}).setdefault(a, set()).add(at - then)
    clock: dict[int, int] = {}
    for root in range(len(case.length_m)):
        reached = [root] if root not in clock else []
        clock.setdefault(root, 0)
        while reached:
            a = reached.pop()
            for b, gaps in after.get(a, {}).items():
                expected = {(clock[a] + gap) % length_ms for gap in gaps}
                if b not in clock:
                    clock[b] = min(expected)
                    reached.append(b)
                if expected != {clock[b]}:
                    return None
    return np.array([clock[link] for link in range(len(case.length_m))], dtype=np.int64)
