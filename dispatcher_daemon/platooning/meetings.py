"""Savings of platoons on open segments, with incremental evaluation of changes.

On a segment, each vehicle of a platoon saves by its place: the leader, and behind it the follower
of a platoon of two, or in longer ones those in the middle and the last one. By the paper's law all
followers save the same, so that m ≥ 2 vehicles save L + (m − 1) F: the pairwise sum of the paper
would count m(m − 1)/2 pairs (FINDINGS, "The paper", 8).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.platooning.platoons import platoons_of
from dispatcher_daemon.platooning.reductions import planned_reductions
from dispatcher_daemon.platooning.segment_order import Change, SegmentOrder
from dispatcher_daemon.platooning.stretches import Traversal
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Route, planning_speed_mps
from dispatcher_daemon.traffic import GateForecast, SegmentTraffic, TrafficSnapshot
from slipstream.energy import drag_saving_kwh
from slipstream.roads import Segment
from slipstream.vehicle_types import RoutingProfile

ALWAYS_OPEN: Final = GateForecast(open=True)

Traversals = Mapping[str, Sequence[Traversal]]
"""One vehicle's passages of segments whose gate is open, or may be then, by segment."""


@dataclass(frozen=True)
class Shares:
    """Energy that one vehicle saves on one segment while its gate is open, kWh.

    Attributes:
        leader_kwh: in front of any number of followers.
        follower_kwh: behind a leader, as the only follower.
        longer_kwh: in a platoon of three and more, between two others and as the last one; None:
            as the only follower, each.
        gate: of the segment. Savings count with the chance that it is open when they begin.
    """

    leader_kwh: float
    follower_kwh: float
    longer_kwh: tuple[float, float] | None = None
    gate: GateForecast = ALWAYS_OPEN

    def at(self, number: int, members: int) -> float:
        """Saving at one place.

        Args:
            number: 0 is the leader.
            members: of the platoon, at least two.
        """
        if number == 0:
            return self.leader_kwh
        if members == 2 or self.longer_kwh is None:
            return self.follower_kwh
        middle_kwh, last_kwh = self.longer_kwh
        return last_kwh if number == members - 1 else middle_kwh

    def following_kwh(self, entry_s: float) -> float:
        """Saving of an only follower, with the chance that the gate is open at its entry."""
        return self.follower_kwh * self.gate.chance(entry_s)

    def followings_kwh(self, entries_s: Sequence[float]) -> list[float]:
        """`following_kwh` of each of some entries."""
        if self.gate.usual_share is None:
            return [self.following_kwh(0.0)] * len(entries_s)
        return [self.following_kwh(entry_s) for entry_s in entries_s]

    def platoon_kwh(self, members: int) -> float:
        """Saving of a platoon of at least two vehicles that all have these shares."""
        if members == 2 or self.longer_kwh is None:
            return self.leader_kwh + (members - 1) * self.follower_kwh
        middle_kwh, last_kwh = self.longer_kwh
        return self.leader_kwh + (members - 2) * middle_kwh + last_kwh


def open_shares(
    problem: RoutingProblem, snapshot: TrafficSnapshot, profile: RoutingProfile | None = None
) -> dict[str, Shares]:
    """Shares of all segments whose gate is open, or may be later on.

    Args:
        profile: of the vehicles; None: the fleet's first.
    """
    of = problem.profiles[0] if profile is None else profile

    def shares(segment: Segment, traffic: SegmentTraffic) -> Shares:
        speed = planning_speed_mps(segment, traffic, of)
        leader, follower, middle, last = (
            drag_saving_kwh(segment.length_m, speed, eta, of.physics)
            for eta in planned_reductions(problem, of, speed)
        )
        alike = middle == last == follower
        return Shares(leader, follower, None if alike else (middle, last), traffic.gate)

    return {
        name: shares(problem.network.segments[name], traffic)
        for name, traffic in snapshot.segments.items()
        if traffic.gate.may_be_open
    }


def traversals(
    number: int, route: Route, shares: Mapping[str, Shares]
) -> dict[str, list[Traversal]]:
    """A route's passages of open segments."""
    found: dict[str, list[Traversal]] = {}
    for leg, visit in zip(route.legs, route.visits, strict=False):
        times = (*leg.drive.entry_s, leg.drive.duration_s)
        for position, segment in enumerate(leg.path):
            if segment in shares:
                entry, leaving = times[position], times[position + 1]
                found.setdefault(segment, []).append(
                    (visit.departure_s + entry, visit.departure_s + leaving, (number,))
                )
    return found


def saving_kwh(
    passages: Sequence[Traversal],
    shares: Shares,
    sync_window_s: float,
    own: Mapping[int, Shares] | None = None,
) -> float:
    """Saving of all platoons on one segment, kWh.

    Args:
        passages: in the order of entry.
        own: shares of vehicles that have others, by their number.
    """
    return _platoons_kwh(platoons_of(passages, sync_window_s), shares, own)


def _platoons_kwh(
    platoons: Iterable[Sequence[Traversal]], shares: Shares, own: Mapping[int, Shares] | None
) -> float:
    total = 0.0
    for group in platoons:
        if len(group) < 2:
            continue
        if own:
            leader, *followers = (
                own.get(number, shares).at(place, len(group))
                for place, (_, _, (number,)) in enumerate(group)
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
    ) -> None:
        """Start with empty roads.

        Args:
            shares: by segment.
            own_shares: of vehicles that have others, by their number; of the same segments.
        """
        self.shares, self.sync_window_s = shares, sync_window_s
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
                return _platoons_kwh((platoon,), shares, own)

            self._orders[segment] = SegmentOrder(self.sync_window_s, kwh)
        return self._orders[segment]
