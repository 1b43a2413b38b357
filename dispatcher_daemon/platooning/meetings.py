"""Savings of platoons on open segments, with incremental evaluation of changes.

On a segment, each vehicle of a platoon saves by its place: the leader, and behind it the follower
of a platoon of two, or in longer ones those in the middle and the last one. By the paper's law all
followers save the same, so that m ≥ 2 vehicles save L + (m − 1) F: the pairwise sum of the paper
would count m(m − 1)/2 pairs (FINDINGS, "The paper", 8). What is expected of it by the vehicles'
approaches: see `dispatcher_daemon.platooning.expected`.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from dispatcher_daemon.platooning.expected import ExpectedDrafting
from dispatcher_daemon.platooning.platoons import (
    TimedPassage,
    independent_platoons,
    platoons_of,
)
from dispatcher_daemon.platooning.shares import Shares
from dispatcher_daemon.roads import Route

Traversal = TimedPassage[tuple[int, ...]]
"""A passage by a vehicle's number in the fleet, with its approach if `ExpectedDrafting` counts."""
Traversals = Mapping[str, Sequence[Traversal]]
"""One vehicle's passages of segments whose gate is open, or may be then, by segment."""


def traversals(
    number: int,
    route: Route,
    shares: Mapping[str, Shares],
    expected: ExpectedDrafting | None = None,
) -> dict[str, list[Traversal]]:
    """A route's passages of open segments."""
    found: dict[str, list[Traversal]] = {}
    for at, (leg, visit) in enumerate(zip(route.legs, route.visits, strict=False)):
        times = (*leg.drive.entry_s, leg.drive.duration_s)
        approaches = () if expected is None else expected.of_leg(route.vehicle, at, leg)
        for position, segment in enumerate(leg.path):
            if segment in shares:
                entry, leaving = times[position], times[position + 1]
                key = (number, *approaches[position : position + 1])
                found.setdefault(segment, []).append(
                    (visit.departure_s + entry, visit.departure_s + leaving, key)
                )
    return found


def saving_kwh(
    passages: Sequence[Traversal],
    shares: Shares,
    sync_window_s: float,
    own: Mapping[int, Shares] | None = None,
    expected: ExpectedDrafting | None = None,
) -> float:
    """Saving of all platoons on one segment, kWh.

    Args:
        passages: in the order of entry.
        own: shares of vehicles that have others, by their number.
        expected: of platoons; None: they are close everywhere.
    """
    return _platoons_kwh(platoons_of(passages, sync_window_s), shares, own, expected)


def _platoons_kwh(
    platoons: Iterable[Sequence[Traversal]],
    shares: Shares,
    own: Mapping[int, Shares] | None,
    expected: ExpectedDrafting | None,
) -> float:
    total = 0.0
    for group in platoons:
        members = len(group)
        if members < 2:
            continue
        if own or expected is not None:
            close = (1.0,) * members
            if expected is not None:
                close = expected.shares(tuple(key[1] for _, _, key in group))
            leader, *followers = (
                share * (own.get(key[0], shares) if own else shares).at(place, members)
                for place, (share, (_, _, key)) in enumerate(zip(close, group, strict=True))
            )
            saved = leader + sum(followers)
        else:
            saved = shares.platoon_kwh(len(group))
        total += saved * shares.gate.chance(group[0][0])
    return total


@dataclass
class _Road:
    """Passages of one segment in the order of entry, and what they save.

    Attributes:
        begins: first passages of the stretches of `independent_platoons`.
        saved_kwh: of each stretch.
    """

    passages: list[Traversal] = field(default_factory=list)
    begins: list[Traversal] = field(default_factory=list)
    saved_kwh: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Change:
    """What passages that come and go on one segment change.

    Attributes:
        saving_kwh: by how much more is saved.
        begin: first passage of the part of the segment's order that is formed anew.
        end: first passage behind it, None: it reaches to the last one. Changes with parts of their
            own add up.
    """

    saving_kwh: float
    begin: Traversal
    end: Traversal | None
    _replaced: slice
    _begins: list[Traversal]
    _saved_kwh: list[float]

    def touches(self, other: Change) -> bool:
        """Whether both form some of the same platoons anew."""
        before = self.end is not None and self.end <= other.begin
        behind = other.end is not None and other.end <= self.begin
        return not before and not behind


class Meetings:
    """Passages of open segments by all vehicles, with the sum of their platoons' savings."""

    def __init__(
        self,
        shares: Mapping[str, Shares],
        sync_window_s: float,
        own_shares: Mapping[int, Mapping[str, Shares]] | None = None,
        expected: ExpectedDrafting | None = None,
    ) -> None:
        """Start with empty roads.

        Args:
            shares: by segment.
            own_shares: of vehicles that have others, by their number; of the same segments.
            expected: of platoons, by the approaches of the passages; None: they are close
                everywhere.
        """
        self.shares, self.sync_window_s = shares, sync_window_s
        self._expected = expected
        self._own_shares = own_shares or {}
        self._own: dict[str, dict[int, Shares]] = {}
        self._roads: dict[str, _Road] = {}

    def add(self, traversals: Traversals) -> float:
        """Put a vehicle on the roads; the change in total savings, kWh."""
        return sum(self._apply(segment, (), on) for segment, on in traversals.items())

    def remove(self, traversals: Traversals) -> float:
        """Take a vehicle off; the change in total savings, kWh."""
        return sum(self._apply(segment, off, ()) for segment, off in traversals.items())

    def gain_kwh(self, traversals: Traversals) -> float:
        """What a vehicle's passages save, those of them counted that are on the roads already."""
        total = 0.0
        for segment, passages in traversals.items():
            there = [p for p in passages if self._is_on(segment, p)]
            new = [p for p in passages if p not in there]
            if new:
                total += self.change(segment, (), new).saving_kwh
            if there:
                total -= self.change(segment, there, ()).saving_kwh
        return total

    def on(self, segment: str) -> Sequence[Traversal]:
        """Passages of a segment in the order of entry."""
        road = self._roads.get(segment)
        return () if road is None else road.passages

    def change(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> Change:
        """What passages of a segment that go, and others that come, at least one of both, would
        change. Platoons are formed anew from the stretch that the first one lies in until a stretch
        behind the last one begins where one has begun before.

        Raises:
            ValueError: one that goes is not there.
        """
        road = self._roads.setdefault(segment, _Road())
        changed = sorted((*off, *on))
        first, last = changed[0], changed[-1]
        begins, there = road.begins, road.passages
        replaced_from = max(0, bisect_right(begins, first) - 1)
        replaced_to = bisect_right(begins, last)
        begin = min(first, begins[replaced_from]) if begins else first
        onward = there[bisect_left(there, begin) :]
        for passage in off:
            onward.remove(passage)
        for passage in on:
            insort(onward, passage)
        new_begins: list[Traversal] = []
        new_kwh: list[float] = []
        at = 0
        while at < len(onward):
            replaced_to = bisect_left(begins, onward[at], replaced_to)
            if begins[replaced_to : replaced_to + 1] == [onward[at]]:
                break
            new_begins.append(onward[at])
            at, platoons = independent_platoons(onward, at, self.sync_window_s)
            new_kwh.append(self._platoons_kwh(segment, platoons))
        else:
            replaced_to = len(begins)
        return Change(
            sum(new_kwh) - sum(road.saved_kwh[replaced_from:replaced_to]),
            begin,
            begins[replaced_to] if replaced_to < len(begins) else None,
            slice(replaced_from, replaced_to),
            new_begins,
            new_kwh,
        )

    def _apply(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> float:
        if not off and not on:
            return 0.0
        change, road = self.change(segment, off, on), self._roads[segment]
        for passage in off:
            del road.passages[bisect_left(road.passages, passage)]
        for passage in on:
            insort(road.passages, passage)
        road.begins[change._replaced] = change._begins
        road.saved_kwh[change._replaced] = change._saved_kwh
        return change.saving_kwh

    def _is_on(self, segment: str, passage: Traversal) -> bool:
        there = self.on(segment)
        at = bisect_left(there, passage)
        return at < len(there) and there[at] == passage

    def _platoons_kwh(self, segment: str, platoons: Iterable[Sequence[Traversal]]) -> float:
        if self._own_shares and segment not in self._own:
            self._own[segment] = {n: of[segment] for n, of in self._own_shares.items()}
        own = self._own.get(segment)
        return _platoons_kwh(platoons, self.shares[segment], own, self._expected)
