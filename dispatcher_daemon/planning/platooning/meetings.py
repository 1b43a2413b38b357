"""Savings of platoons on open segments, with incremental evaluation of changes.

On a segment, each vehicle of a platoon saves by its place: the leader, and behind it the follower
of a platoon of two, or in longer ones those in the middle and the last one. By the paper's law all
followers save the same, so that m ≥ 2 vehicles save L + (m − 1) F: the pairwise sum of the paper
would count m(m − 1)/2 pairs (FINDINGS, "The paper", 8). What is expected of it by the vehicles'
approaches: see `dispatcher_daemon.planning.platooning.expected`.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from dispatcher_daemon.planning.platooning.expected import ExpectedDrafting
from dispatcher_daemon.planning.platooning.platoons import parted
from dispatcher_daemon.planning.platooning.segment_order import Change, SegmentOrder
from dispatcher_daemon.planning.platooning.shares import Shares
from dispatcher_daemon.planning.platooning.stretches import Traversal

Traversals = Mapping[str, Sequence[Traversal]]
"""One vehicle's passages of segments whose gate is open, or may be then, by segment."""


def group_kwh(
    group: Sequence[Traversal],
    longest: int,
    shares: Shares,
    own: Mapping[int, Shares],
    expected: ExpectedDrafting | None,
) -> float:
    """Saving of the platoons that a group is parted into on a segment, kWh.

    Args:
        own: shares of vehicles that have others, by their number.
    """
    if len(group) <= longest:
        return _platoon_kwh(group, shares, own, expected)
    return sum(_platoon_kwh(one, shares, own, expected) for one in parted(group, longest))


def _platoon_kwh(
    platoon: Sequence[Traversal],
    shares: Shares,
    own: Mapping[int, Shares],
    expected: ExpectedDrafting | None,
) -> float:
    members = len(platoon)
    if members < 2:
        return 0.0
    if own or expected is not None:
        close = (1.0,) * members
        if expected is not None:
            close = expected.shares(tuple(key[1] for _, _, key in platoon))
        leader, *followers = (
            share * own.get(key[0], shares).at(place, members)
            for place, (share, (_, _, key)) in enumerate(zip(close, platoon, strict=True))
        )
        saved = leader + sum(followers)
    else:
        saved = shares.platoon_kwh(members)
    return saved * shares.gate.chance(platoon[0][0])


class Meetings:
    """Passages of open segments by all vehicles, with the sum of their platoons' savings."""

    def __init__(
        self,
        shares: Mapping[str, Shares],
        sync_window_s: float,
        longest: int,
        own_shares: Mapping[int, Mapping[str, Shares]] | None = None,
        expected: ExpectedDrafting | None = None,
    ) -> None:
        """Start with empty roads.

        Args:
            longest: number of vehicles that a platoon has at most.
            own_shares: of vehicles that have others, by their number; of the same segments.
        """
        self.shares, self.sync_window_s = shares, sync_window_s
        self._longest, self._expected = longest, expected
        self._own_shares = own_shares or {}
        self._orders: dict[str, SegmentOrder] = {}
        self._before: dict[str, SegmentOrder] | None = None

    def add(self, traversals: Traversals) -> float:
        """Put a vehicle on the roads; the change in total savings, kWh."""
        return sum(self._apply(segment, (), on) for segment, on in traversals.items())

    def remove(self, traversals: Traversals) -> float:
        """Take a vehicle off; the change in total savings, kWh."""
        return sum(self._apply(segment, off, ()) for segment, off in traversals.items())

    @contextmanager
    def tried(self) -> Iterator[None]:
        """What is changed within is as before at the end; not one within another."""
        self._before = {}
        try:
            yield
        finally:
            self._orders |= self._before
            self._before = None

    def gain_kwh(self, traversals: Traversals) -> float:
        """What a vehicle's passages save, those of them counted that are on the roads already."""
        (gain,) = self.gains_kwh((traversals,))
        return gain

    def gains_kwh(self, options: Iterable[Traversals]) -> list[float]:
        """`gain_kwh` of each of some options of one vehicle, which have passages in common."""
        known: dict[tuple[str, tuple[Traversal, ...]], float] = {}
        gains: list[float] = []
        for option in options:
            total = 0.0
            for segment, passages in option.items():
                key = segment, tuple(passages)
                gain = known.get(key)
                if gain is None:
                    gain = known[key] = self._gain_kwh(segment, passages)
                total += gain
            gains.append(total)
        return gains

    def _gain_kwh(self, segment: str, passages: Sequence[Traversal]) -> float:
        order = self._order(segment)
        there = [p for p in passages if p in order]
        new = [p for p in passages if p not in there] if there else passages
        gain = 0.0
        if len(new) == 1:
            gain = order.gain_kwh(new[0])
        elif new:
            gain = order.change((), new).saving_kwh
        return gain - order.change(there, ()).saving_kwh if there else gain

    def on(self, segment: str) -> Sequence[Traversal]:
        """Passages of a segment in the order of entry."""
        return self._order(segment).passages

    def entries_s(self, segment: str, from_s: float, before_s: float, but: int) -> array[float]:
        """Entries into a segment from one moment on and before another, in their order.

        Args:
            but: number of the vehicle whose entries do not count.
        """
        order = self._order(segment)
        begin = bisect_left(order.entries_s, from_s)
        end = bisect_left(order.entries_s, before_s)
        entries, numbers = order.entries_s[begin:end], order.numbers[begin:end]
        if but not in numbers:
            return entries
        return array("d", [s for s, n in zip(entries, numbers, strict=True) if n != but])

    def change(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> Change:
        """What passages of a segment that go, and others that come, would change."""
        return self._order(segment).change(off, on)

    def _apply(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> float:
        if not off and not on:
            return 0.0
        order = self._order(segment)
        if self._before is not None and segment not in self._before:
            self._before[segment] = order.copy()
        return order.apply(off, on)

    def _order(self, segment: str) -> SegmentOrder:
        if segment not in self._orders:
            shares = self.shares[segment]
            longest, expected = self._longest, self._expected
            own = {n: of[segment] for n, of in self._own_shares.items()}
            self._orders[segment] = SegmentOrder(
                self.sync_window_s, lambda group: group_kwh(group, longest, shares, own, expected)
            )
        return self._orders[segment]
