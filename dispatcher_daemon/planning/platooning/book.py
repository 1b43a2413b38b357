"""The book of meetings: where vehicles save something by being close, and who is there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dispatcher_daemon.fleet import Commitment, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning.expected import Approach
from dispatcher_daemon.planning.platooning.meetings import Meetings, Traversals
from dispatcher_daemon.planning.platooning.shares import Shares, open_shares
from dispatcher_daemon.planning.platooning.stretches import Traversal
from dispatcher_daemon.planning.platooning.vehicles_on_road import (
    counted_drafting,
    traversals_on_road,
)
from dispatcher_daemon.planning.roads import RoadLeg, Route
from dispatcher_daemon.traffic import TrafficSnapshot

_OpenPassage = tuple[str, float, float, tuple[Approach, ...]]
"""(segment, entry and leaving in s after the leg's departure, approach if one counts)."""


class MeetingBook:
    """Open segments of one fleet under one traffic snapshot.

    Attributes:
        longest: number of vehicles that a platoon has at most.
        shares: savings of the fleet's first profile by place, on each open segment.
        shares_by_profile: those of all its profiles.
        expected: of platoons; None: they are close everywhere.
        on_road: passages of open segments by vehicles that earlier cycles sent.
    """

    def __init__(
        self,
        problem: RoutingProblem,
        snapshot: TrafficSnapshot,
        sync_window_s: float,
        on_road: Sequence[RoadUser] = (),
        commitments: Sequence[Commitment] = (),
    ) -> None:
        self.sync_window_s, self.longest = sync_window_s, problem.longest_platoon
        first, *others = problem.profiles
        self.shares: Mapping[str, Shares] = open_shares(problem, snapshot, first)
        self.shares_by_profile = {
            first: self.shares,
            **{other: open_shares(problem, snapshot, other) for other in others},
        }
        self.expected = counted_drafting(problem, snapshot, commitments, on_road)
        # By the drive's identity, which lasts as the leg is kept with it.
        self._known: dict[tuple[int, Approach], tuple[RoadLeg, list[_OpenPassage]]] = {}
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
        meetings = Meetings(
            self.shares, self.sync_window_s, self.longest, self._own_shares, self.expected
        )
        for vehicle in self.on_road:
            meetings.add(vehicle)
        return meetings

    def traversals(self, number: int, route: Route) -> dict[str, tuple[Traversal, ...]]:
        """A route's passages of open segments, by the number of its vehicle."""
        found: dict[str, tuple[Traversal, ...]] = {}
        for at, (leg, visit) in enumerate(zip(route.legs, route.visits, strict=False)):
            leaves_s = visit.departure_s
            for segment, entry, leaving, approach in self._of_leg(route.vehicle, at, leg):
                passage = (leaves_s + entry, leaves_s + leaving, (number, *approach))
                known = found.get(segment)
                found[segment] = (passage,) if known is None else (*known, passage)
        return found

    def _of_leg(self, vehicle: str, at: int, leg: RoadLeg) -> list[_OpenPassage]:
        """Looked up once for each drive, as options of a route have most legs in common."""
        expected = self.expected
        key = id(leg.drive), -1 if expected is None else expected.start_of(vehicle, at)
        known = self._known.get(key)
        if known is not None and known[0].path is leg.path:
            return known[1]
        times = (*leg.drive.entry_s, leg.drive.duration_s)
        approaches = () if expected is None else expected.of_leg(vehicle, at, leg)
        found = [
            (segment, times[n], times[n + 1], approaches[n : n + 1])
            for n, segment in enumerate(leg.path)
            if segment in self.shares
        ]
        self._known[key] = leg, found
        return found

    def followed_kwh(self, traversals: Traversals, from_s: float) -> float:
        """What a vehicle saves that follows another one on all open segments from a moment on."""
        return sum(
            self.shares[segment].following_kwh(entry)
            for segment, passages in traversals.items()
            for entry, _, _ in passages
            if entry >= from_s
        )
