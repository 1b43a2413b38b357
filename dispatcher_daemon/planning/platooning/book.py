"""The book of meetings: where vehicles save something by being close, and who is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dispatcher_daemon.fleet import Commitment, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning.meetings import Meetings, OpenPassages, Traversals
from dispatcher_daemon.planning.platooning.shares import Shares, open_shares
from dispatcher_daemon.planning.platooning.vehicles_on_road import (
    counted_drafting,
    traversals_on_road,
)
from dispatcher_daemon.planning.roads import Route
from dispatcher_daemon.traffic import TrafficSnapshot


class MeetingBook:
    """Open segments of one fleet under one traffic snapshot.

    Attributes:
        shares: saving of a leader and of a follower of the fleet's first profile on each open
            segment.
        shares_by_profile: those of all its profiles.
        expected: of platoons; None: they are close everywhere.
        on_road: passages of open segments by vehicles that earlier cycles sent; they stay as they
            are.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        snapshot: TrafficSnapshot,
        sync_window_s: float,
        on_road: Sequence[RoadUser] = (),
        commitments: Sequence[Commitment] = (),
    ) -> None:
        self.sync_window_s = sync_window_s
        first, *others = problem.profiles
        self.shares: Mapping[str, Shares] = open_shares(problem, snapshot, first)
        self.shares_by_profile = {
            first: self.shares,
            **{other: open_shares(problem, snapshot, other) for other in others},
        }
        self.expected = counted_drafting(problem, snapshot, commitments, on_road)
        self._passages = OpenPassages(self.shares, self.expected)
        self.on_road = traversals_on_road(on_road, self.shares, self.expected)
        # A vehicle on the road that has left the fleet counts as one of its first profile.
        users = [(-n, user.vehicle) for n, user in enumerate(on_road, 1)]
        self._own_shares = {
            number: self.shares_by_profile[problem.profile_of(name)]
            for number, name in (*enumerate(v.id for v in problem.fleet.vehicles), *users)
            if name in problem.fleet.vehicle_by_id and problem.profile_of(name) != first
        }

    def meetings(self) -> Meetings:
        """Passages of the vehicles on the road only; their savings are part of no change."""
        meetings = Meetings(self.shares, self.sync_window_s, self._own_shares, self.expected)
        for vehicle in self.on_road:
            meetings.add(vehicle)
        return meetings

    def traversals(self, number: int, route: Route) -> Traversals:
        """A route's passages of open segments."""
        return self._passages.of(number, route)

    def followed_kwh(self, traversals: Traversals, from_s: float) -> float:
        """What a vehicle saves that follows another one on all open segments from a moment on."""
        return sum(
            self.shares[segment].following_kwh(entry)
            for segment, passages in traversals.items()
            for entry, _, _ in passages
            if entry >= from_s
        )
