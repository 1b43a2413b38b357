"""Savings of platoons on open segments, with incremental evaluation of changes.

On a segment, each vehicle of a platoon saves by its place: the leader, and behind it the follower
of a platoon of two, or in longer ones those in the middle and the last one. By the paper's law all
followers save the same, so that m ≥ 2 vehicles save L + (m − 1) F: the pairwise sum of the paper
would count m(m − 1)/2 pairs (FINDINGS, "The paper", 8). What is expected of it by the vehicles'
approaches: see `dispatcher_daemon.platooning.expected`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from dispatcher_daemon.platooning.expected import ExpectedDrafting
from dispatcher_daemon.platooning.platoons import platoons_of
from dispatcher_daemon.platooning.segment_order import Change, SegmentOrder
from dispatcher_daemon.platooning.shares import Shares
from dispatcher_daemon.platooning.stretches import Traversal
from dispatcher_daemon.roads import Route

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
        self._orders: dict[str, SegmentOrder] = {}

    def add(self, traversals: Traversals) -> float:
        """Put a vehicle on the roads; the change in total savings, kWh."""
        return sum(self._apply(segment, (), on) for segment, on in traversals.items())

    def remove(self, traversals: Traversals) -> float:
        """Take a vehicle off; the change in total savings, kWh."""
        return sum(self._apply(segment, off, ()) for segment, off in traversals.items())

    def gain_kwh(self, traversals: Traversals) -> float:
        """What a vehicle's passages save, those of them counted that are on the roads already."""
        (gain,) = self.gains_kwh((traversals,))
        return gain

    def gains_kwh(self, options: Iterable[Traversals]) -> list[float]:
        """`gain_kwh` of each of some options of one vehicle, which have passages in common."""
        known: dict[tuple[str, tuple[Traversal, ...]], float] = {}

        def gain_kwh(segment: str, passages: Sequence[Traversal]) -> float:
            key = segment, tuple(passages)
            if key not in known:
                known[key] = self._gain_kwh(segment, passages)
            return known[key]

        return [sum(gain_kwh(s, p) for s, p in option.items()) for option in options]

    def _gain_kwh(self, segment: str, passages: Sequence[Traversal]) -> float:
        order = self._order(segment)
        there = [p for p in passages if p in order]
        new = [p for p in passages if p not in there] if there else passages
        gain = order.change((), new).saving_kwh if new else 0.0
        return gain - order.change(there, ()).saving_kwh if there else gain

    def on(self, segment: str) -> Sequence[Traversal]:
        """Passages of a segment in the order of entry."""
        order = self._orders.get(segment)
        return () if order is None else order.passages

    def change(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> Change:
        """What passages of a segment that go, and others that come, at least one of both, would
        change.

        Raises:
            ValueError: one that goes is not there.
        """
        return self._order(segment).change(off, on)

    def _apply(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> float:
        return self._order(segment).apply(off, on) if off or on else 0.0

    def _order(self, segment: str) -> SegmentOrder:
        if segment not in self._orders:
            shares = self.shares[segment]
            own = {n: of[segment] for n, of in self._own_shares.items()}

            def kwh(platoon: Sequence[Traversal]) -> float:
                return _platoons_kwh((platoon,), shares, own, self._expected)

            self._orders[segment] = SegmentOrder(self.sync_window_s, kwh)
        return self._orders[segment]
