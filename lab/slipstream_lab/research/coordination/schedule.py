"""Everybody's present schedule, and one trip's best answer to it by dynamic programming."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from slipstream_lab.research.coordination.case import CoordinationCase, Floats, Ints
from slipstream_lab.research.coordination.plan import Plan

_COUNTS: Final = 1024
"""Others in a slot that are told apart."""


@dataclass(frozen=True)
class Worth:
    """What it is worth to be with others on a link, in shares of its savings. `leader`: share of a
    leader's saving by the number of others, from 0 on.
    """

    leader: Floats
    follower: Floats

    @classmethod
    def to_all(cls) -> Self:
        """What a further vehicle adds to all savings: with one other, both sides of a platoon;
        with more, one more follower.
        """
        return cls(np.eye(_COUNTS)[1], np.minimum(np.arange(_COUNTS), 1.0))

    @classmethod
    def equally_shared(cls) -> Self:
        """What it has itself where a platoon's saving is shared equally."""
        others = np.arange(_COUNTS)
        return cls(np.minimum(others, 1) / (others + 1), others / (others + 1))


class Schedule:
    """Who enters which link when; changed trip by trip.

    Vehicles of one slot, as long as the synchronisation window, are taken for a platoon. Those on
    both sides of a slot's end are not: the evaluation of a whole plan finds them.
    """

    def __init__(self, case: CoordinationCase, plan: Plan, driving: Ints | None = None) -> None:
        """Put trips on the roads. `driving`: those that are; None: all. The others can be added."""
        self.case, self.plan = case, plan.copy()
        self._first_ms = int(case.ready_ms.min())
        last_ms = int(case.ready_ms.max() + case.slack_ms.max() + case.offset_ms.max())
        slots = (last_ms - self._first_ms) // case.sync_window_ms + 1
        self._counts = np.zeros((len(case.length_m), slots), dtype=np.int16)
        self._users = [np.argwhere(case.link == link) for link in range(len(case.length_m))]
        self._entries = [np.full(len(users), np.iinfo(np.int64).min) for users in self._users]
        self._place = np.zeros(case.link.shape, dtype=np.int64)
        for users in self._users:
            self._place[users[:, 0], users[:, 1]] = np.arange(len(users))
        self._parts = [self._part(trip) for trip in range(len(plan))]
        self._is_driving = np.zeros(len(plan), dtype=bool)
        for trip in range(len(plan)) if driving is None else driving.tolist():
            self.add(trip, self.plan[trip])

    def add(self, trip: int, delays_ms: Ints) -> None:
        """Put a trip on its way with these delays, one a stretch."""
        part = self._parts[trip]
        self.plan[trip] = delays_ms
        entries = part.undelayed_ms + delays_ms[part.stretch]
        self._counts[part.link, self._slot(entries)] += 1
        for link, place, entry in zip(part.links, part.places, entries.tolist(), strict=True):
            self._entries[link][place] = entry
        self._is_driving[trip] = True

    def remove(self, trip: int) -> None:
        """Take a trip off the roads."""
        part = self._parts[trip]
        entries = part.undelayed_ms + self.plan[trip, part.stretch]
        self._counts[part.link, self._slot(entries)] -= 1
        for link, place in zip(part.links, part.places, strict=True):
            self._entries[link][place] = np.iinfo(np.int64).min
        self._is_driving[trip] = False

    def value_kwh(self, trip: int, delays_ms: Ints, worth: Worth) -> float:
        """Value of these delays to a trip that is off the roads."""
        part = self._parts[trip]
        entries = part.undelayed_ms + delays_ms[part.stretch]
        others = np.minimum(self._counts[part.link, self._slot(entries)], _COUNTS - 1)
        gain = part.leader_kwh @ worth.leader[others] + part.follower_kwh @ worth.follower[others]
        stops = part.stop_kwh[1:][np.diff(delays_ms) > 0].sum()
        return float(gain - stops - self.case.price_kwh_per_ms * delays_ms[-1])

    def best(self, trip: int, worth: Worth) -> tuple[float, Ints]:
        """(Value in kWh, delays) of the best answer of a trip that is off the roads.

        It may enter each link with the others there or undelayed, and wait at its origin and at
        each hub: a dynamic program over stretches and delays.
        """
        case, part = self.case, self._parts[trip]
        delays = self._candidates(trip)
        entries = part.undelayed_ms[:, None] + delays
        others = np.minimum(self._counts[part.link[:, None], self._slot(entries)], _COUNTS - 1)
        gains = (
            part.leader_kwh[:, None] * worth.leader[others]
            + part.follower_kwh[:, None] * worth.follower[others]
        )
        value = -case.price_kwh_per_ms * delays
        by_stretch = np.add.reduceat(gains, part.begins, axis=0)
        values: list[Floats] = []
        for number in range(len(by_stretch) - 1, -1, -1):
            value = value + by_stretch[number]
            values.append(value)
            if number > 0 and len(delays) > 1:
                later = np.maximum.accumulate(value[:0:-1])[::-1] - part.stop_kwh[number]
                value = np.append(np.maximum(value[:-1], later), value[-1])
        values.reverse()
        return float(values[0].max()), self._traced(trip, values, delays)

    def _traced(self, trip: int, values: list[Floats], delays: Ints) -> Ints:
        """The delays that lead to the best value; with equal ones the shortest."""
        stop_kwh = self._parts[trip].stop_kwh
        chosen = np.empty(self.plan.shape[1], dtype=np.int64)
        at = int(values[0].argmax())
        chosen[:] = delays[at]
        for number, value in enumerate(values[1:], 1):
            if at + 1 < len(value):
                later = at + 1 + int(value[at + 1 :].argmax())
                if value[later] - stop_kwh[number] > value[at]:
                    at = later
            chosen[number:] = delays[at]
        return chosen

    def _candidates(self, trip: int) -> Ints:
        """Delays, in order, at which the trip meets another one as a stretch begins; and 0."""
        part = self._parts[trip]
        longest = int(self.case.useful_ms[trip])
        found = [np.zeros(1, dtype=np.int64)]
        for at in part.begins.tolist():
            delays = self._entries[part.links[at]] - part.undelayed_ms[at]
            found.append(delays[(delays > 0) & (delays <= longest)])
        return np.unique(np.concatenate(found))

    def _slot(self, entries_ms: Ints) -> Ints:
        return (entries_ms - self._first_ms) // self.case.sync_window_ms

    def _part(self, trip: int) -> _Part:
        case, count = self.case, int(self.case.link_count[trip])
        link, stretch = case.link[trip, :count], case.stretch[trip, :count]
        begins = np.flatnonzero(np.append(True, np.diff(stretch) > 0))
        return _Part(
            link,
            link.tolist(),
            self._place[trip, :count].tolist(),
            stretch,
            begins,
            case.ready_ms[trip] + case.offset_ms[trip, :count],
            case.leader_kwh[link],
            case.follower_kwh[link],
            case.stop_kwh[trip],
        )


@dataclass(frozen=True)
class _Part:
    """One trip's rows of the case, without padding."""

    link: Ints
    links: list[int]
    places: list[int]
    stretch: Ints
    begins: Ints
    undelayed_ms: Ints
    leader_kwh: Floats
    follower_kwh: Floats
    stop_kwh: Floats


def answer_in_turn(
    case: CoordinationCase, plan: Plan, worth: Worth, max_rounds: int, order: Ints | None = None
) -> Plan:
    """Each trip in turn takes its best answer to the others, until nobody changes. `order`: of the
    turns; None: as the trips get ready.
    """
    schedule = Schedule(case, plan)
    turns = np.argsort(case.ready_ms, kind="stable") if order is None else order
    for _ in range(max_rounds):
        changed = 0
        for trip in turns.tolist():
            before = schedule.plan[trip].copy()
            schedule.remove(trip)
            _, delays = schedule.best(trip, worth)
            schedule.add(trip, delays)
            changed += bool((delays != before).any())
        if not changed:
            break
    return schedule.plan
