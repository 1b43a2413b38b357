"""Trips as arrays: the form that strategies, evaluation and bound work on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from slipstream_lab.research.coordination.trips.freight import MS, Freight, FreightSegment, Trip

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class CoordinationCase:
    """A day's trips with the price of waiting.

    A *link* is a run of open segments that every trip on one of them drives wholly. A *stretch* is
    a trip's way between two places where it may wait; before the first it waits at its origin. All
    arrays of links by trip have one row a trip, −1 where it has fewer links than others.

    Attributes:
        follower_kwh: saving of a follower, shape (links,).
        leader_kwh: saving of a leader, shape (links,).
        length_m: shape (links,).
        duration_ms: shape (links,).
        ready_ms: earliest departure, shape (trips,).
        slack_ms: longest wait in all, shape (trips,).
        link: links of each trip, shape (trips, most links of a trip).
        offset_ms: from departure to the entry, same shape.
        stretch: number of the stretch that the link is on, same shape.
        stop_kwh: energy of a wait before each stretch, shape (trips, most stretches of a trip); 0
            before the first; infinite where a trip has no such stretch.
        carrier: number of each trip's carrier, shape (trips,).
        ceiling_kwh: saving if every vehicle were a follower on all segments of its way, closed
            ones included.
    """

    freight: Freight
    price_kw: float
    sync_window_ms: int
    follower_kwh: Floats
    leader_kwh: Floats
    length_m: Floats
    duration_ms: Ints
    ready_ms: Ints
    slack_ms: Ints
    link: Ints
    offset_ms: Ints
    stretch: Ints
    stop_kwh: Floats
    carrier: Ints
    ceiling_kwh: float

    @property
    def price_kwh_per_ms(self) -> float:
        """`price_kw` for the arrays' unit of time."""
        return self.price_kw / (3600 * MS)

    @cached_property
    def link_count(self) -> Ints:
        """Number of links of each trip, shape (trips,)."""
        return np.asarray((self.link >= 0).sum(axis=1), dtype=np.int64)

    @cached_property
    def useful_ms(self) -> Ints:
        """Longest wait of each trip that can pay: all that it can add to the saving is worth it.

        A trip that joins turns at most a vehicle alone into a leader and is a follower itself.
        """
        if self.price_kw == 0:
            return self.slack_ms
        most = np.append(self.follower_kwh + self.leader_kwh, 0.0)[self.link].sum(axis=1)
        paying = np.floor(most / self.price_kwh_per_ms).astype(np.int64)
        return np.asarray(np.minimum(self.slack_ms, paying))


def build_case(freight: Freight, price_kw: float, sync_window_s: float) -> CoordinationCase:
    """The arrays of some trips. Raises ValueError: a price that is negative or not finite."""
    first_of = _links(freight)
    numbers: dict[str, int] = {}
    parts: list[list[FreightSegment]] = []
    rows = [_row(freight, trip, first_of, numbers, parts) for trip in freight.trips]
    most_links = max(len(row.link) for row in rows)
    most_stretches = max(len(row.stop_kwh) for row in rows)
    carriers = {name: k for k, name in enumerate(sorted({t.carrier for t in freight.trips}))}

    def padded(values: list[list[int]], width: int) -> Ints:
        return np.array([row + [-1] * (width - len(row)) for row in values], dtype=np.int64)

    return CoordinationCase(
        freight,
        price_kw,
        round(MS * sync_window_s),
        np.array([sum(part.follower_kwh for part in link) for link in parts]),
        np.array([sum(part.leader_kwh for part in link) for link in parts]),
        np.array([sum(part.length_m for part in link) for link in parts]),
        np.array([sum(part.duration_ms for part in link) for link in parts], dtype=np.int64),
        np.array([trip.ready_ms for trip in freight.trips], dtype=np.int64),
        np.array([freight.slack_ms(trip) for trip in freight.trips], dtype=np.int64),
        padded([row.link for row in rows], most_links),
        padded([row.offset_ms for row in rows], most_links),
        padded([row.stretch for row in rows], most_links),
        np.array([r.stop_kwh + [np.inf] * (most_stretches - len(r.stop_kwh)) for r in rows]),
        np.array([carriers[trip.carrier] for trip in freight.trips], dtype=np.int64),
        sum(freight.segments[s].follower_kwh for trip in freight.trips for s in trip.path),
    )


@dataclass(frozen=True)
class _Row:
    link: list[int]
    offset_ms: list[int]
    stretch: list[int]
    stop_kwh: list[float]


def _row(
    freight: Freight,
    trip: Trip,
    first_of: Mapping[str, str],
    numbers: dict[str, int],
    parts: list[list[FreightSegment]],
) -> _Row:
    """A trip's arrays; links that are new get a number and their segments."""
    row = _Row([], [], [], [0.0])
    offset_ms = 0
    for name in trip.path:
        segment = freight.segments[name]
        if segment.is_open:
            first = first_of[name]
            if first == name:
                if row.link and segment.stop_kwh is not None:
                    row.stop_kwh.append(segment.stop_kwh)
                if name not in numbers:
                    numbers[name] = len(parts)
                    parts.append([])
                row.link.append(numbers[name])
                row.offset_ms.append(offset_ms)
                row.stretch.append(len(row.stop_kwh) - 1)
            at = parts[numbers[first]]
            if not any(part is segment for part in at):
                at.append(segment)
        offset_ms += segment.duration_ms
    return row


def _links(freight: Freight) -> dict[str, str]:
    """The first segment of each open segment's link."""
    before: dict[str, set[str | None]] = {}
    after: dict[str, set[str | None]] = {}
    for path in {trip.path for trip in freight.trips}:
        for left, name in zip((None, *path), (*path, None), strict=True):
            if name is not None:
                before.setdefault(name, set()).add(left)
            if left is not None:
                after.setdefault(left, set()).add(name)
    first_of: dict[str, str] = {}

    def first(name: str) -> str:
        if name not in first_of:
            segment = freight.segments[name]
            previous = next(iter(before[name]))
            joined = (
                segment.stop_kwh is None
                and len(before[name]) == 1
                and previous is not None
                and freight.segments[previous].is_open
                and after[previous] == {name}
            )
            first_of[name] = first(previous) if joined and previous is not None else name
        return first_of[name]

    for name in before:
        if freight.segments[name].is_open:
            first(name)
    return first_of
