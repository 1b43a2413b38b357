from __future__ import annotations

import random
import time
from dataclasses import replace

import pytest

from dispatcher_daemon.service.vroom.least_missed import MissedEvent, least_missed
from dispatcher_daemon.service.vroom.model import FOREVER

LAST = 16
"""Of the times that are tried one by one."""
EPOCH = 174_099_960_000
"""A moment of 2025 in hundredths of a second."""


def tried(events: list[MissedEvent]) -> list[int] | None:
    """The best times of all: least misses, earliest end, latest start, the rest early."""
    best: tuple[int, ...] | None = None

    def go_on(times: list[int], missed: int) -> None:
        nonlocal best
        number = len(times)
        if best is not None and missed > best[0]:
            return
        if number == len(events):
            key = (missed, times[-1], -times[0], *times[1:-1])
            best = key if best is None else min(best, key)
            return
        event, soonest = events[number], events[number].low
        if times:
            soonest = max(soonest, times[-1] + events[number - 1].lasts)
        if times and event.travel is not None:
            place = max(n for n in range(number) if events[n].travel is not None)
            own = events[place:number]
            driven = own[0].travel or 0
            soonest = max(soonest, times[place] + sum(e.lasts for e in own) + driven)
        for moment in range(soonest, min(LAST, event.high) + 1):
            misses = (max(0, a - moment, moment - b) for a, b in event.windows)
            go_on([*times, moment], missed + min(misses))

    go_on([], 0)
    return None if best is None else [-best[2], *best[3:], best[1]]


def some_events(rng: random.Random) -> list[MissedEvent]:
    """Two to five steps with breaks between, several windows and hard bounds."""
    events = []
    size = rng.randint(2, 5)
    for number in range(size):
        windows = []
        for _ in range(rng.randint(1, 3)):
            start = rng.randint(0, 10)
            windows.append((start, start + rng.randint(0, 3)))
        always = rng.random() < 0.25
        is_break = 0 < number < size - 1 and rng.random() < 0.4
        low = rng.randint(0, 6) if rng.random() < 0.15 else 0
        events.append(
            MissedEvent(
                ((0, FOREVER),) if always else tuple(sorted(windows)),
                low,
                low + rng.randint(0, 8) if rng.random() < 0.15 else FOREVER,
                rng.randint(0, 2) if number else 0,
                None if is_break else rng.randint(0, 3),
            )
        )
    return events


@pytest.mark.slow
def test_the_times_are_the_best_of_all() -> None:
    """Of small routes all times are tried."""
    rng, compared = random.Random(1), 0
    for _ in range(40):
        events = some_events(rng)
        found, best = least_missed(events, time.monotonic() + 60), tried(events)
        if found is not None and found[-1] > LAST:
            continue
        assert found == best, events
        compared += best is not None
    assert compared > 10


@pytest.mark.slow
def test_times_of_any_epoch_are_the_same_ones_later() -> None:
    """However large they are, they are exact."""
    rng = random.Random(2)
    for _ in range(10):
        events = some_events(rng)
        found = least_missed(events, time.monotonic() + 60)
        later = [
            replace(
                event,
                windows=tuple(
                    (EPOCH + a, EPOCH + b if b < FOREVER else b) for a, b in event.windows
                ),
                low=EPOCH + event.low,
                high=EPOCH + event.high if event.high < FOREVER else FOREVER,
            )
            for event in events
        ]
        shifted = None if found is None else [EPOCH + moment for moment in found]
        assert least_missed(later, time.monotonic() + 60) == shifted


def test_whoever_has_no_time_left_is_told() -> None:
    """Where time is over before a route's end is reached."""
    events = [MissedEvent(((0, 5),), 0, FOREVER, 1, 1)] * 3
    with pytest.raises(TimeoutError):
        least_missed(events, time.monotonic() - 1)
