"""Savings of platoons on open segments, with incremental evaluation of changes.

On a segment, each vehicle of a platoon saves by its place: the leader, and behind it the follower
of a platoon of two, or in longer ones those in the middle and the last one. By the paper's law all
followers save the same, so that m ≥ 2 vehicles save L + (m − 1) F: the pairwise sum of the paper
would count m(m − 1)/2 pairs (FINDINGS, "The paper", 8).
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from dispatcher_daemon.platooning.platoons import TimedPassage, platoons_of
from dispatcher_daemon.platooning.reductions import planned_reductions
from dispatcher_daemon.platooning.stretches import Stretch, stretch_at
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


_Stretches = tuple[list[Traversal], list[Stretch[VehicleNumber]]]
"""First passages of some stretches, and the stretches."""


def _total_kwh(stretches: Sequence[Stretch[VehicleNumber]]) -> float:
    return sum([stretch.total_kwh for stretch in stretches])


@dataclass
class _Road:
    """Passages of one segment in the order of entry, and what they save.

    Attributes:
        begins: first passages of the stretches of `independent_platoons`.
        stretches: these.
    """

    passages: list[Traversal] = field(default_factory=list)
    begins: list[Traversal] = field(default_factory=list)
    stretches: list[Stretch[VehicleNumber]] = field(default_factory=list)


@dataclass(slots=True)
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
    _stretches: list[Stretch[VehicleNumber]]

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
    ) -> None:
        """Start with empty roads.

        Args:
            shares: by segment.
            own_shares: of vehicles that have others, by their number; of the same segments.
        """
        self.shares, self.sync_window_s = shares, sync_window_s
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
        there = [p for p in passages if self._is_on(segment, p)]
        new = [p for p in passages if p not in there] if there else passages
        gain = self.change(segment, (), new).saving_kwh if new else 0.0
        return gain - self.change(segment, there, ()).saving_kwh if there else gain

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
        begins = road.begins
        replaced = slice(max(0, bisect_right(begins, first) - 1), bisect_right(begins, last))
        begin = min(first, begins[replaced.start]) if begins else first
        found = self._adjusted(segment, road, replaced, off, on)
        if found is None:
            found = self._formed(segment, road, replaced, begin, off, on)
        replaced, (new_begins, stretches) = found
        return Change(
            _total_kwh(stretches) - _total_kwh(road.stretches[replaced]),
            begin,
            begins[replaced.stop] if replaced.stop < len(begins) else None,
            replaced,
            new_begins,
            stretches,
        )

    def _formed(
        self,
        segment: str,
        road: _Road,
        replaced: slice,
        begin: Traversal,
        off: Sequence[Traversal],
        on: Sequence[Traversal],
    ) -> tuple[slice, _Stretches]:
        """(stretches that are replaced, those in their place), formed anew from a passage on."""
        begins, there = road.begins, road.passages
        new_begins: list[Traversal] = []
        stretches: list[Stretch[VehicleNumber]] = []
        first = min((*off, *on))
        if begin < first and road.stretches[replaced.start].ends_before(first, self.sync_window_s):
            new_begins, stretches = [begin], [road.stretches[replaced.start]]
            begin = first
        onward = there[bisect_left(there, begin) :]
        for passage in off:
            onward.remove(passage)
        for passage in on:
            insort(onward, passage)
        at, end = 0, replaced.stop
        while at < len(onward):
            end = bisect_left(begins, onward[at], end)
            if begins[end : end + 1] == [onward[at]]:
                break
            new_begins.append(onward[at])
            at, platoons, vehicles = stretch_at(onward, at, self.sync_window_s)
            saved_kwh = [self._platoons_kwh(segment, (platoon,)) for platoon in platoons]
            stretches.append(Stretch(platoons, saved_kwh, vehicles))
        else:
            end = len(begins)
        return slice(replaced.start, end), (new_begins, stretches)

    def _adjusted(
        self,
        segment: str,
        road: _Road,
        replaced: slice,
        off: Sequence[Traversal],
        on: Sequence[Traversal],
    ) -> tuple[slice, _Stretches] | None:
        """The same where passages that go and come leave all others as they are; None: they have to
        be formed anew.
        """
        window_s, stop = self.sync_window_s, replaced.stop
        begins, stretches = road.begins[replaced], road.stretches[replaced]
        for passage in off:
            at = bisect_right(begins, passage) - 1
            if at < 0:
                return None
            if begins[at] == passage and stretches[at].is_one_alone:
                del begins[at], stretches[at]
                continue
            found = stretches[at].platoon_without(passage)
            if found is None:
                return None
            number, platoon = found
            if begins[at] == passage:
                later = begins[at + 1 : at + 2] or road.begins[stop : stop + 1]
                if later and later[0][0] - platoon[0][0] <= window_s:
                    return None
                begins[at] = platoon[0]
            stretches[at] = self._with_platoon(segment, stretches[at], passage, number, platoon)
        for passage in on:
            at = bisect_right(begins, passage) - 1
            if at >= 0 and not stretches[at].ends_before(passage, window_s):
                found = stretches[at].platoon_with(passage, window_s)
                if found is None:
                    return None
                stretches[at] = self._with_platoon(segment, stretches[at], passage, *found)
                continue
            at += 1
            if at == len(begins) and stop < len(road.begins):
                if road.begins[stop][0] - passage[0] <= window_s:
                    begins.append(road.begins[stop])
                    stretches.append(road.stretches[stop])
                    stop += 1
            if at == len(begins) or begins[at][0] - passage[0] > window_s:
                begins.insert(at, passage)
                stretches.insert(at, Stretch([[passage]], [0.0], frozenset(passage[2])))
                continue
            led = stretches[at].platoon_led_by(passage, window_s)
            if led is None:
                return None
            begins[at] = passage
            stretches[at] = self._with_platoon(segment, stretches[at], passage, 0, led)
        return slice(replaced.start, stop), (begins, stretches)

    def _with_platoon(
        self,
        segment: str,
        stretch: Stretch[VehicleNumber],
        passage: Traversal,
        number: int,
        platoon: Sequence[Traversal],
    ) -> Stretch[VehicleNumber]:
        """The stretch with a platoon that a passage has joined or left."""
        saved_kwh = self._platoons_kwh(segment, (platoon,))
        return stretch.replaced(number, platoon, saved_kwh, passage)

    def _apply(self, segment: str, off: Sequence[Traversal], on: Sequence[Traversal]) -> float:
        if not off and not on:
            return 0.0
        change, road = self.change(segment, off, on), self._roads[segment]
        for passage in off:
            del road.passages[bisect_left(road.passages, passage)]
        for passage in on:
            insort(road.passages, passage)
        road.begins[change._replaced] = change._begins
        road.stretches[change._replaced] = change._stretches
        return change.saving_kwh

    def _is_on(self, segment: str, passage: Traversal) -> bool:
        there = self.on(segment)
        at = bisect_left(there, passage)
        return at < len(there) and there[at] == passage

    def _platoons_kwh(self, segment: str, platoons: Iterable[Sequence[Traversal]]) -> float:
        if self._own_shares and segment not in self._own:
            self._own[segment] = {n: of[segment] for n, of in self._own_shares.items()}
        return _platoons_kwh(platoons, self.shares[segment], self._own.get(segment))
