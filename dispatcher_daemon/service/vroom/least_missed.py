"""When the steps of a described route begin so that they miss their windows least, exactly: a
mixed-integer programme, solved by HiGHS.

Given the windows, all constraints bound differences of two times by whole numbers, so that the
vertices of the programme are whole.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dispatcher_daemon.service.vroom.model import FOREVER, Windows


@dataclass(frozen=True)
class MissedEvent:
    """A step; times are whole numbers of one unit.

    Attributes:
        windows: in which it begins without a miss.
        low: hard bound, not before it.
        high: likewise, not after it.
        travel: from there to the next place; None: a break, which has no place.
    """

    windows: Windows
    low: int
    high: int
    lasts: int
    travel: int | None


def least_missed(events: Sequence[MissedEvent], ends: float) -> list[int] | None:
    """When each step begins: of the times with the least sum of misses those with the earliest end,
    then with the latest start, then with the rest as early as possible in sum; None: the hard
    bounds contradict each other.

    Args:
        events: in order; the first and the last one are places.
        ends: when to be done, by the monotonic clock.

    Raises:
        TimeoutError: it took longer.
    """
    whole = sum(event.lasts + (event.travel or 0) for event in events)
    windows = {window for event in events for window in event.windows} - {(0, FOREVER)}
    wanted = {m for w in windows for m in w} | {event.low for event in events if event.low}
    given = (wanted | {event.high for event in events}) - {FOREVER}
    # Times count from here: of small numbers floats are exact.
    begin = max(0, min(given) - whole) if wanted else 0
    latest = max(given, default=0) - begin + whole
    count = len(events)
    # Of each step: when it begins, the nearest time in its windows, how far these are apart.
    low = np.array([max(0, event.low - begin) for event in events] * 2 + [0] * count, dtype=float)
    high = np.full(3 * count, float(latest))
    high[:count] = [min(latest, event.high - begin) for event in events]
    rows: list[tuple[dict[int, float], float]] = []
    for number, event in enumerate(events):
        at, near, missed = number, count + number, 2 * count + number
        own = [(max(0, a - begin), min(latest, b - begin)) for a, b in event.windows]
        low[near], high[near] = own[0][0], max(end for _, end in own)
        rows += [({missed: 1, at: -1, near: 1}, 0.0), ({missed: 1, at: 1, near: -1}, 0.0)]
        if len(own) > 1:
            chosen = range(len(low), len(low) + len(own))
            low, high = np.append(low, [0.0] * len(own)), np.append(high, [1.0] * len(own))
            starts, stops = zip(*own, strict=True)
            rows += [
                ({near: 1, **{c: -a for c, a in zip(chosen, starts, strict=True)}}, 0.0),
                ({near: -1, **dict(zip(chosen, stops, strict=True))}, 0.0),
                (dict.fromkeys(chosen, 1.0), 1.0),
                (dict.fromkeys(chosen, -1.0), -1.0),
            ]
    for a, b, apart in _distances(events):
        rows.append(({b: 1, a: -1}, float(apart)))
    if (low > high).any():
        return None
    misses = np.zeros(len(low))
    misses[2 * count : 3 * count] = 1.0
    begins, first, last = (np.zeros(len(low)) for _ in range(3))
    begins[:count], first[0], last[count - 1] = 1.0, -1.0, 1.0
    found = None
    for aim in (misses, last, first, begins):
        found = _solved(aim, rows, low, high, 3 * count, ends)
        if found is None:
            return None
        rows.append(({int(n): -aim[n] for n in np.flatnonzero(aim)}, -float(round(found.fun))))
    assert found is not None
    return [begin + round(moment) for moment in found.x[:count]]


def _distances(events: Sequence[MissedEvent]) -> Iterator[tuple[int, int, int]]:
    """(step, later step, least time between their begins)."""
    places = [number for number, event in enumerate(events) if event.travel is not None]
    for a, b in pairwise(places):
        yield a, b, sum(event.lasts for event in events[a:b]) + (events[a].travel or 0)
        if b > a + 1:
            yield from ((n, n + 1, events[n].lasts) for n in range(a, b))


def _solved(
    aim: np.ndarray,
    rows: Sequence[tuple[dict[int, float], float]],
    low: np.ndarray,
    high: np.ndarray,
    whole_from: int,
    ends: float,
) -> Any:
    """The least of an aim, rows being (factors, lower bound); None: there is no solution."""
    # The dispatcher imports this module, and only its worker solves.
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    left_s = ends - time.monotonic()
    if left_s <= 0:
        raise TimeoutError
    entries = [(r, c, v) for r, (row, _) in enumerate(rows) for c, v in row.items()]
    at, columns, values = zip(*entries, strict=True)
    matrix = coo_array((values, (at, columns)), shape=(len(rows), len(low))).tocsr()
    found = milp(
        aim,
        integrality=(np.arange(len(low)) >= whole_from).astype(int),
        bounds=Bounds(low, high),
        constraints=LinearConstraint(matrix, lb=[bound for _, bound in rows]),
        options={"time_limit": left_s, "mip_rel_gap": 0.0, "presolve": False},
    )
    if found.status == 1:
        raise TimeoutError
    return found if found.x is not None else None
