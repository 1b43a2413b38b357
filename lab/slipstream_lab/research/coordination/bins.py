"""Bins of time for the bound: on each link a clock of its own, so that a trip stays in its bin."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from slipstream_lab.research.coordination.case import Bools, CoordinationCase, Floats, Ints

_LENGTHS_MS: Final = tuple(
    round(1000 * s) for s in (0.5, 1, 2, 3, 4, 5, 8, 10, 16, 20, 25, 40, 50, 80, 100, 200, 400)
)
_MAX_BINS: Final = 400
"""Of a trip: with more of them the descent needs more iterations."""
_MAX_CELLS: Final = 2_500_000
"""Greatest number of (trip, link, bin), about: memory and time grow with it."""
_PARTS: Final = 8


@dataclass(frozen=True)
class TripPart:
    """Trips of about the same number of links, so that their arrays have little padding.

    A *pool* is a link and a bin: vehicles that may platoon there behind one that enters in it.

    Attributes:
        delay_ms: least delay in a bin, shape (trips, bins).
        reached: bins that a trip has, same shape.
        pool: number of each trip's pools, shape (links of a trip, trips, bins + ahead): at k those
            of the bin k − ahead; 0 is no pool.
    """

    trips: Ints
    delay_ms: Floats
    reached: Bools
    pool: Ints


@dataclass(frozen=True)
class Bins:
    """Where each trip can be, by bins of its delay.

    Attributes:
        ahead: so many bins before its own may the first vehicle of a trip's platoon be.
        link: of each pool; −1 of the first, which is none.
    """

    length_ms: int
    ahead: int
    parts: tuple[TripPart, ...]
    link: Ints


def choose_bins(case: CoordinationCase) -> Bins:
    """The shortest bins that fit the driving times and the memory. Where no clocks keep each trip
    in its bin, as round a ring or where two ways between the same links take other times, a trip
    counts in both bins that it may be in: the bound holds, less near.
    """
    longest_ms = int(case.useful_ms.max() + 1)
    in_all_ms = int((case.link_count * (case.useful_ms + 1)).sum())
    at_least_ms = max(longest_ms / _MAX_BINS, in_all_ms / _MAX_CELLS)
    lengths_ms = [some for some in _LENGTHS_MS if some >= at_least_ms] or [_LENGTHS_MS[-1]]
    for length_ms in lengths_ms:
        clock = _clocks(case, length_ms)
        if clock is not None:
            return _bins(case, length_ms, clock, 0)
    return _bins(case, lengths_ms[0], np.zeros(len(case.length_m), dtype=np.int64), 1)


def _bins(case: CoordinationCase, length_ms: int, clock: Ints, loose: int) -> Bins:
    """`loose`: 1 where a trip may be in two bins of a link, else 0."""
    ahead = -(-case.sync_window_ms // length_ms) + loose
    present = case.link >= 0
    at_ms = case.ready_ms[:, None] + case.offset_ms - np.append(clock, 0)[case.link]
    base, phase_ms = np.divmod(at_ms, length_ms)
    # The later of the two; `ahead` reaches the earlier one.
    base += loose - (phase_ms < phase_ms[:, :1])
    count = (phase_ms[:, 0] + case.useful_ms) // length_ms + 1
    low = int(base[present].min()) - ahead
    width = int(base[present].max()) - low + int(count.max()) + 1
    parts = []
    order = np.lexsort((count, case.link_count))
    for trips in np.array_split(order, min(_PARTS, len(order))):
        numbers = np.arange(int(count[trips].max()))
        reached = numbers < count[trips, None]
        delay_ms = np.maximum(numbers * length_ms - phase_ms[trips, :1], 0).astype(np.float64)
        in_pool = np.zeros((len(trips), len(numbers) + ahead), dtype=bool)
        for shift in range(ahead + 1):
            in_pool[:, shift : shift + len(numbers)] |= reached
        links = case.link[trips, : int(case.link_count[trips].max())].T
        first = links * width + base[trips, : len(links)].T - low
        keys = first[..., None] + np.arange(-ahead, len(numbers))
        pool = np.where(in_pool & (links >= 0)[..., None], keys, -1) + 1
        parts.append(TripPart(trips, delay_ms, reached, pool))
    used = np.unique(np.concatenate([[0], *(part.pool.ravel() for part in parts)]))
    numbered = (replace(part, pool=np.searchsorted(used, part.pool)) for part in parts)
    return Bins(length_ms, ahead, tuple(numbered), np.where(used > 0, (used - 1) // width, -1))


def _clocks(case: CoordinationCase, length_ms: int) -> Ints | None:
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
