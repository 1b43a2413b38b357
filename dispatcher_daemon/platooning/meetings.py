"""Savings of platoons on open segments, with incremental evaluation of changes.

On a segment, each vehicle of a platoon saves by its place: the leader, and behind it the follower
of a platoon of two, or in longer ones those in the middle and the last one. By the paper's law all
followers save the same, so that m ≥ 2 vehicles save L + (m − 1) F: the pairwise sum of the paper
would count m(m − 1)/2 pairs (FINDINGS, "The paper", 8).
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.platooning.platoons import TimedPassage, platoons_of
from dispatcher_daemon.platooning.reductions import planned_reductions
from dispatcher_daemon.problem import RoutingProblem
from dispatcher_daemon.roads import Route, planning_speed_mps
from dispatcher_daemon.traffic import GateForecast, SegmentTraffic, TrafficSnapshot
from slipstream.energy import drag_saving_kwh
from slipstream.roads import Segment
from slipstream.vehicle_types import RoutingProfile

ALWAYS_OPEN: Final = GateForecast(open=True)

VehicleNumber = tuple[int]
"""A vehicle's number in the fleet."""
Traversal = TimedPassage[VehicleNumber]
Traversals = Mapping[str, Sequence[Traversal]]
"""One vehicle's passages of open segments, by segment."""


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
    total = 0.0
    for group in platoons_of(passages, sync_window_s):
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
        self._own: dict[str, dict[int, Shares]] = {}
        self._on: dict[str, list[Traversal]] = {}

    def add(self, traversals: Traversals) -> float:
        """Put a vehicle on the roads; the change in total savings, kWh."""
        return self._change({}, traversals)

    def remove(self, traversals: Traversals) -> float:
        """Take a vehicle off; the change in total savings, kWh."""
        return self._change(traversals, {})

    def gain_kwh(self, traversals: Traversals) -> float:
        """The change that `add` would make."""
        total = 0.0
        for segment, passages in traversals.items():
            for near in self._near(segment, passages):
                before = [p for p in near if p not in passages]
                total += self.saving_kwh(segment, near) - self.saving_kwh(segment, before)
        return total

    def saving_kwh(self, segment: str, passages: Sequence[Traversal]) -> float:
        """Saving of all platoons among some passages of a segment, kWh; in the order of entry."""
        if self._own_shares and segment not in self._own:
            self._own[segment] = {n: of[segment] for n, of in self._own_shares.items()}
        own = self._own.get(segment)
        return saving_kwh(passages, self.shares[segment], self.sync_window_s, own)

    def on(self, segment: str) -> Sequence[Traversal]:
        """Passages of a segment in the order of entry."""
        return self._on.get(segment, ())

    def _change(self, off: Traversals, on: Traversals) -> float:
        total = 0.0
        for segment in {**off, **on}:
            old, new = off.get(segment, ()), on.get(segment, ())
            around = [*old, *new]
            total -= sum(self.saving_kwh(segment, near) for near in self._near(segment, around, ()))
            there = self._on.setdefault(segment, [])
            for passage in old:
                there.remove(passage)
            for passage in new:
                insort(there, passage)
            total += sum(self.saving_kwh(segment, near) for near in self._near(segment, around, ()))
        return total

    def _near(
        self,
        segment: str,
        around: Sequence[Traversal],
        added: Sequence[Traversal] | None = None,
    ) -> Iterator[list[Traversal]]:
        """Clusters of passages that some of ``around`` fall into, ``added`` (or all of them)
        among them: passages further apart than the window do not meet.
        """
        there = self._on.get(segment, [])
        extra = around if added is None else added
        chosen: set[int] = set()
        for passage in around:
            at = bisect_left(there, passage)
            chosen.update(self._reach(there, at, passage[0]))
        merged = sorted([*(there[i] for i in chosen), *extra])
        yield from clusters(merged, self.sync_window_s)

    def _reach(self, there: list[Traversal], at: int, entry_s: float) -> Iterable[int]:
        low, edge = at, entry_s
        while low > 0 and edge - there[low - 1][0] <= self.sync_window_s:
            low -= 1
            edge = there[low][0]
        high, edge = at, entry_s
        while high < len(there) and there[high][0] - edge <= self.sync_window_s:
            edge = there[high][0]
            high += 1
        return range(low, high)


def clusters(passages: Sequence[Traversal], sync_window_s: float) -> Iterator[list[Traversal]]:
    """Split at gaps longer than the window; passages in the order of entry."""
    cluster: list[Traversal] = []
    for passage in passages:
        if cluster and passage[0] - cluster[-1][0] > sync_window_s:
            yield cluster
            cluster = []
        cluster.append(passage)
    if cluster:
        yield cluster
