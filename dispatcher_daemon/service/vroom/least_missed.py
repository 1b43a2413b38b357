"""When the steps of a described route begin so that they miss their windows least, exactly.

What comes before a step bounds its time from below only. So the least sum of misses is found step
by step, first from the front, then from the back. In some best times each step is at an end of a
window, or as far from that of another step as what lies between takes: others are not looked at.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.service.vroom.model import FOREVER, Ints, Windows

_NONE: Final = 2**61
"""Misses where there is no way to begin then; more than any sum of others."""
_Times = tuple[Ints, Ints]
"""(times in order, misses up to there)."""


@dataclass(frozen=True)
class MissedEvent:
    """A step; times are whole numbers of one unit.

    Attributes:
        windows: in which it begins without a miss.
        low: hard bound, not before it.
        high: likewise, not after it.
        lasts: how long it takes.
        travel: from there to the next place; None: a break, which has no place.
    """

    windows: Windows
    low: int
    high: int
    lasts: int
    travel: int | None


@dataclass(frozen=True)
class _Leg:
    """From one place to the next, forwards or backwards.

    Attributes:
        pauses: numbers of breaks on it.
        gaps: least times from each step to the next one.
        whole: least time from place to place.
        to: number of the place where it ends.
    """

    pauses: tuple[int, ...]
    gaps: tuple[int, ...]
    whole: int
    to: int


def least_missed(events: Sequence[MissedEvent], ends: float) -> list[int] | None:
    """When each step begins: of the times with the least sum of misses those with the earliest end,
    then with the latest start, then with the rest as early as possible; None: the hard bounds
    contradict each other.

    Args:
        events: in order; the first and the last one are places.
        ends: when to be done, by the monotonic clock.

    Raises:
        TimeoutError: it took longer.
    """
    chain = _Chain(events, ends)
    labels = chain.moments(0, 0, chain.clear(0, 0))
    soonest = [0]
    for leg in chain.legs:
        labels = chain.followed(_earliest(labels), leg)
        soonest.append(int(labels[0].min(initial=0)))
    times, misses = _earliest(labels)
    if not times.size:
        return None
    least = int(misses[-1])  # of what is not yet passed
    last = len(events) - 1
    # Backwards all times are negative.
    labels = -times[-1:], chain.missed(last, times[-1:])
    to_go = {last: (times[-1:], labels[1])}
    for (place, leg), moment in zip(chain.backward(), soonest[-2::-1], strict=True):
        at, costs = chain.followed(_earliest(labels), leg, back_to=moment)
        labels = at[costs <= least], costs[costs <= least]
        to_go[place] = -labels[0][::-1], labels[1][::-1]
    at, costs = to_go[0]
    begins = [int(at[costs == least][-1])]
    least -= chain.missed_at(0, begins[0])
    for leg in chain.legs:
        begins += chain.soonest(begins[-1], least, leg, to_go[leg.to])
        least -= sum(chain.missed_at(n, begins[n]) for n in (*leg.pauses, leg.to))
    return begins


class _Chain:
    """Steps with the times that are looked at."""

    def __init__(self, events: Sequence[MissedEvent], ends: float) -> None:
        self._events, self._ends = events, ends
        places = [n for n, event in enumerate(events) if event.travel is not None]
        self.legs = [self._leg(a, b) for a, b in pairwise(places)]
        offsets: list[tuple[int, ...]] = [(0,)]
        for leg in self.legs:
            begin = offsets[-1][0]
            after, before = np.cumsum(leg.gaps), np.cumsum(leg.gaps[::-1])[::-1]
            # A break begins as soon as the step before it is over, or so that the next one can.
            offsets += [
                (begin + int(after[i]), begin + leg.whole - int(before[i + 1]))
                for i in range(len(leg.pauses))
            ]
            offsets.append((begin + leg.whole,))
        self._offsets = offsets
        bends = {
            moment - offset
            for event, of in zip(events, offsets, strict=True)
            for moment in (*(m for w in event.windows for m in w), event.low, event.high)
            for offset in of
            if moment < FOREVER
        }
        self._bends: Ints = np.array(sorted(bends), dtype=np.int64)

    def _leg(self, a: int, b: int) -> _Leg:
        own = self._events[a:b]
        lasting = tuple(event.lasts for event in own)
        whole = sum(lasting) + (own[0].travel or 0)
        pauses = tuple(range(a + 1, b))
        return _Leg(pauses, lasting if pauses else (whole,), whole, b)

    def backward(self) -> Iterator[tuple[int, _Leg]]:
        """(place, the leg that leads back to it), from the end."""
        places = [0, *(leg.to for leg in self.legs)]
        for place, leg in zip(places[-2::-1], self.legs[::-1], strict=True):
            yield place, _Leg(leg.pauses[::-1], leg.gaps[::-1], leg.whole, place)

    def missed(self, number: int, at: Ints) -> Ints:
        """By how much a step misses its windows."""
        found = np.full(len(at), _NONE)
        for start, end in self._events[number].windows:
            found = np.minimum(found, np.maximum(0, np.maximum(start - at, at - end)))
        return found

    def clear(self, number: int, moment: int, *, backwards: bool = False) -> int:
        """The first time from a moment on from which waiting saves a step no misses."""
        event = self._events[number]
        if backwards:
            moment = min(-moment, event.high)
            return -max(
                (min(moment, end) for start, end in event.windows if start <= moment),
                default=moment,
            )
        moment = max(moment, event.low)
        return next((max(moment, start) for start, end in event.windows if moment <= end), moment)

    def moments(self, number: int, first: int, last: int, *, backwards: bool = False) -> _Times:
        """The times of a step that are looked at between two, with what it misses by then."""
        event = self._events[number]
        if backwards:
            first, last = -last, -first
        first, last = max(first, event.low), min(last, event.high)
        every = [
            self._bends[slice(*np.searchsorted(self._bends, (first - o, last - o + 1)))] + o
            for o in self._offsets[number]
        ]
        at = every[0] if len(every) == 1 else np.unique(np.concatenate(every))
        missed = self.missed(number, at)
        return (-at[::-1], missed[::-1]) if backwards else (at, missed)

    def followed(self, labels: _Times, leg: _Leg, *, back_to: int | None = None) -> _Times:
        """The times of the place where a leg ends, from those of the place where it begins; of
        times that waiting saves nothing after only the first.

        Args:
            back_to: backwards, with all times down to this one; None: forwards.
        """
        backwards = back_to is not None
        if not labels[0].size:
            return labels
        first, last = int(labels[0][0]), int(labels[0][-1])
        soonest, latest, pauses = first, last, list[_Times]()
        for gap, number in zip(leg.gaps, leg.pauses, strict=False):
            soonest, latest = soonest + gap, self.clear(number, latest + gap, backwards=backwards)
            pauses.append(self.moments(number, soonest, latest, backwards=backwards))
        soonest, latest = first + leg.whole, max(latest + leg.gaps[-1], last + leg.whole)
        latest = self.clear(leg.to, latest) if back_to is None else max(latest, -back_to)
        at, missed = self.moments(leg.to, soonest, latest, backwards=backwards)
        if not pauses:
            self._check_time()
            return at, _cheapest(labels, leg.whole, at) + missed
        costs = np.full(len(at), _NONE)
        for moment, cost in zip(*labels, strict=True):
            self._check_time()
            row = _row(moment, cost)
            for gap, (moments, missed_there) in zip(leg.gaps, pauses, strict=False):
                row = _earliest((moments, _cheapest(row, gap, moments) + missed_there))
            reached = _cheapest(row, leg.gaps[-1], at)
            reached[at < moment + leg.whole] = _NONE
            costs = np.minimum(costs, reached)
        return at, costs + missed

    def soonest(self, begin: int, least: int, leg: _Leg, to_go: _Times) -> list[int]:
        """The earliest times of a leg's breaks and of the place where it ends.

        Args:
            begin: of the place where it starts.
            least: misses after that.
            to_go: times of the place where the leg ends, with the misses from there on.
        """
        at, costs = to_go
        row = _row(begin)
        for gap, number in zip(leg.gaps, leg.pauses, strict=False):
            moments, missed = self.moments(number, begin, int(at[-1]))
            row = _earliest((moments, _cheapest(row, gap, moments) + missed))
        reached = _cheapest(row, leg.gaps[-1], at)
        end = _first(at, (at >= begin + leg.whole) & (reached + costs == least))
        left = least - int(costs[at == end][0])
        return [*self._pauses(begin, end, left, leg), end]

    def _pauses(self, begin: int, end: int, least: int, leg: _Leg) -> list[int]:
        """The earliest times of a leg's breaks between those of its places."""
        row, to_go = _row(-end), list[_Times]()
        for gap, number in zip(leg.gaps[::-1], leg.pauses[::-1], strict=False):
            moments, missed = self.moments(number, -end, -begin, backwards=True)
            costs = _cheapest(row, gap, moments) + missed
            to_go.append((-moments[::-1], costs[::-1]))
            row = _earliest((moments, costs))
        found = [begin]
        for gap, number, (at, costs) in zip(leg.gaps, leg.pauses, to_go[::-1], strict=False):
            found.append(_first(at, (at >= found[-1] + gap) & (costs == least)))
            least -= self.missed_at(number, found[-1])
        return found[1:]

    def missed_at(self, number: int, moment: int) -> int:
        """By how much a step misses its windows at a time."""
        return int(self.missed(number, np.array([moment]))[0])

    def _check_time(self) -> None:
        if time.monotonic() > self._ends:
            raise TimeoutError


def _row(moment: int, cost: int = 0) -> _Times:
    return np.array([moment], dtype=np.int64), np.array([cost], dtype=np.int64)


def _first(at: Ints, right: npt.NDArray[np.bool_]) -> int:
    return int(at[right][0])


def _earliest(labels: _Times) -> _Times:
    """Of times those that miss less than all before them."""
    at, costs = labels
    before = np.minimum.accumulate(np.concatenate([[_NONE], costs]))[:-1]
    better = costs < before
    return at[better], costs[better]


def _cheapest(labels: _Times, gap: int, at: Ints) -> Ints:
    """The least misses of what is over a gap before each time, of `_earliest` labels."""
    times, costs = labels
    number = np.searchsorted(times + gap, at, side="right")
    return np.concatenate([[_NONE], costs])[number]
