"""Platoons of the fleet in the running simulation, from step to step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from simulation.closed_loop.platooning import road
from simulation.closed_loop.platooning.meeting import FASTER, Meeting, best_meeting
from simulation.closed_loop.platooning.member import Contact, Member
from simulation.closed_loop.platooning.spacing import (
    Motion,
    close_gap_m,
    coasting_mps2,
    followed_gap_m,
    following_mps,
    is_parted,
    parting_mps,
    parting_way_m,
)
from simulation.closed_loop.platooning.step import PlatoonStep
from simulation.closed_loop.platooning.ways import SharedWay, shared_way
from simulation.closed_loop.vehicle import LegOrder, VehicleState
from slipstream.energy import ETA_FOLLOWER, ETA_LEADER

SLOWEST_MPS: Final = 5.0
"""Below this speed no drag reduction is credited: there is next to no drag."""

_FARTHEST_M: Final = 2000.0
_LOOK_EVERY_S: Final = 2.0
_REJOIN_S: Final = 6.0
_LANE_S: Final = 3.0
_NEAR_SEGMENTS: Final = 3

States = Mapping[str, VehicleState]


class Platooning:
    """Brings vehicles of the fleet together, keeps them close where gates are open, parts them.

    Two vehicles drive as a platoon where one is directly behind the other on its lane, both go the
    same way, the gate of the segment is open and what is left of it makes up for the manoeuvre. The
    follower is then commanded (`following_mps`) under SUMO's safety checks; the leader keeps the
    car-following model that it has in every other arm. The drag reduction is that of the advised
    gap: in a simulation of steps of 0.5 s followers keep 3.75 m, and the gap of 1.5 m is given in
    the evaluation, not in the motion.

    A disengagement is a platoon that parts because a segment that one of its vehicles is on has an
    open gate though its traffic is turbulent in truth. It is counted once, however many vehicles
    the platoon has; its followers do not close up again before that segment is behind them.

    Args:
        open_segments: whether a segment's gate is open now.
        turbulent: whether a segment's traffic is turbulent in truth now.
        step_s: of the simulation.
        segment_lengths: m.
        enabled: whether this arm has platoons; without them nothing is read or set.
    """

    def __init__(
        self,
        open_segments: Callable[[str], bool],
        turbulent: Callable[[str], bool],
        step_s: float,
        segment_lengths: Mapping[str, float],
        enabled: bool,
    ) -> None:
        self._is_open, self._is_turbulent = open_segments, turbulent
        self._step_s, self._lengths = step_s, segment_lengths
        self._enabled = enabled
        self._close_m = close_gap_m(step_s)
        self._members: dict[str, Member] = {}
        self._look_s = 0.0
        self._disengagements = 0

    @property
    def disengagements(self) -> int:
        """Platoons that had to part so far because of turbulent traffic behind an open gate."""
        return self._disengagements

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle came onto the road, or was given another way on it."""
        if not self._enabled:
            return
        if name in self._members:
            self._members[name].order = order
        else:
            road.add_follower_type()
            self._members[name] = Member(order, road.speed_factor(name))

    def ended(self, name: str) -> None:
        """A vehicle is off the road."""
        self._members.pop(name, None)

    def step(self, now_s: float, states: States) -> PlatoonStep:
        """Decide on the coming step, and set it in SUMO but for the speeds in `caps`."""
        members = self._members
        if len(members) < 2 and all(m.mode == "alone" and m.hurry == 1 for m in members.values()):
            return PlatoonStep()
        contacts = self._contacts(states)
        self._disengage(states, contacts, now_s)
        for name in sorted(members):
            self._decide(name, states, contacts, now_s)
        if now_s >= self._look_s:
            self._look_s = now_s + _LOOK_EVERY_S
            self._bring_together(states, contacts)
        caps = self._command(states, contacts)
        return self._told(states, contacts, caps)

    def _contacts(self, states: States) -> dict[str, Contact]:
        """Whom members are behind, of those that may be behind another member."""
        on: dict[str, int] = {}
        for name in self._members:
            on[states[name].segment] = on.get(states[name].segment, 0) + 1
        contacts = {}
        for name, member in self._members.items():
            number = states[name].number
            near = member.order.path[number : number + _NEAR_SEGMENTS]
            if member.mode != "alone" or sum(on.get(segment, 0) for segment in near) > 1:
                found = road.ahead(name)
                if found is not None:
                    contacts[name] = Contact(*found, road.speed_mps(found[0]))
        return contacts

    def _platoons(self, contacts: Mapping[str, Contact]) -> list[list[str]]:
        """Leaders with their close followers, front to back."""
        behind = {
            contact.ahead: name
            for name, contact in contacts.items()
            if self._members[name].mode == "following"
            and contact.ahead == self._members[name].ahead
            and contact.gap_m <= self._close_m
        }
        followers = set(behind.values())
        platoons = []
        for leader in sorted(set(behind) - followers):
            platoon = [leader]
            while platoon[-1] in behind:
                platoon.append(behind[platoon[-1]])
            platoons.append(platoon)
        return platoons

    def _disengage(self, states: States, contacts: Mapping[str, Contact], now_s: float) -> None:
        """Part the platoons that are on a turbulent segment."""
        for platoon in self._platoons(contacts):
            rough = next(
                (s for s in (states[name].segment for name in platoon) if self._is_turbulent(s)),
                None,
            )
            if rough is None or not self._is_open(rough):
                continue
            self._disengagements += 1
            for name in platoon[1:]:
                self._members[name].refused = rough
                self._part(name, now_s)

    def _decide(
        self, name: str, states: States, contacts: Mapping[str, Contact], now_s: float
    ) -> None:
        """Whether a vehicle follows closely, opens its gap or is on its own."""
        member, contact = self._members[name], contacts.get(name)
        if contact is not None and contact.ahead in self._members:
            keeps = member.mode == "following" and member.ahead == contact.ahead
            if keeps or self._may_rejoin(member, contact.ahead, now_s) or member.mode == "alone":
                run_m = self._run_m(name, contact.ahead, states)
                if self._wants(name, contact, run_m, states, keeps=keeps):
                    if member.mode == "alone":
                        member.hurry = 1 + FASTER
                        road.take_over(name, member.factor * member.hurry)
                    member.mode, member.ahead = "following", contact.ahead
                    return
        if member.mode == "following":
            self._part(name, now_s)
            self._stay_behind(name, states)
        if member.mode == "parting" and self._is_apart(name, states, contact):
            road.hand_back(name, member.factor)
            member.mode, member.ahead, member.hurry = "alone", None, 1.0

    def _may_rejoin(self, member: Member, ahead: str, now_s: float) -> bool:
        return (
            member.mode == "parting"
            and member.ahead == ahead
            and member.refused is None
            and now_s - member.parted_s <= _REJOIN_S
        )

    def _run_m(self, name: str, ahead: str, states: States) -> float:
        """From a follower's front to where the platoon has to be parted, m."""
        way = self._way(name, ahead, states)
        return 0.0 if way is None else way.open_run_m(self._is_open)

    def _way(self, rear: str, front: str, states: States) -> SharedWay | None:
        return shared_way(
            (self._members[rear].order, states[rear]),
            (self._members[front].order, states[front]),
            self._lengths,
            _FARTHEST_M,
        )

    def _wants(
        self, name: str, contact: Contact, run_m: float, states: States, *, keeps: bool
    ) -> bool:
        """Whether to follow closely: it is allowed and long enough."""
        member, speed = self._members[name], states[name].speed_mps
        if member.refused is not None:
            if member.refused in member.order.path[states[name].number :]:
                return False
            member.refused = None
        parting_m = parting_way_m(speed, contact.gap_m)
        if keeps or contact.gap_m <= self._close_m:
            return run_m > parting_m
        cruise = max(SLOWEST_MPS, self._desired_mps(name))
        drafted_m = run_m - parting_way_m(cruise, followed_gap_m(self._step_s))
        meeting = best_meeting(
            contact.gap_m - followed_gap_m(self._step_s),
            cruise,
            lambda way_m: max(0.0, drafted_m - way_m),
            ETA_FOLLOWER,
        )
        return meeting is not None

    def _part(self, name: str, now_s: float) -> None:
        member = self._members[name]
        member.mode, member.parted_s = "parting", now_s

    def _stay_behind(self, name: str, states: States) -> None:
        """Follow a leader that has changed its lane."""
        ahead = self._members[name].ahead
        if ahead is None or ahead not in states:
            return
        own, other = states[name], states[ahead]
        same = own.segment == other.segment and not own.crossing and not other.crossing
        if same and own.lane != other.lane and own.front_m < other.front_m:
            road.to_lane(name, other.lane, _LANE_S)

    def _is_apart(self, name: str, states: States, contact: Contact | None) -> bool:
        if contact is None:
            return True
        motion = Motion(states[name].speed_mps, self._desired_mps(name), contact.gap_m)
        return is_parted(motion, contact.ahead_mps)

    def _desired_mps(self, name: str) -> float:
        """What it would drive here if it did not hurry."""
        return road.desired_mps(name) / self._members[name].hurry

    def _bring_together(self, states: States, contacts: Mapping[str, Contact]) -> None:
        """Choose who catches up with whom."""
        members = self._members
        for member in members.values():
            member.yields = 0.0
        hurries: dict[str, float] = {}
        leads = {m.ahead: n for n, m in members.items() if m.mode == "following"}
        taken: set[str] = set()
        for rear in sorted(members):
            if members[rear].mode == "parting":
                continue
            if members[rear].mode == "following" and contacts[rear].gap_m <= self._close_m:
                continue
            found = self._next_meeting(rear, states, leads, taken)
            if found is None:
                continue
            front, meeting = found
            taken.add(front)
            hurries[rear] = 1 + meeting.faster
            while members[front].mode == "following" and members[front].ahead in members:
                front = str(members[front].ahead)
            members[front].yields = max(members[front].yields, meeting.slower)
        for name, member in members.items():
            hurry = 1 + FASTER if member.mode == "following" else hurries.get(name, 1.0)
            if hurry != member.hurry:
                member.hurry = hurry
                road.set_speed_factor(name, member.factor * hurry)

    def _next_meeting(
        self, rear: str, states: States, leads: Mapping[str | None, str], taken: set[str]
    ) -> tuple[str, Meeting] | None:
        """The nearest vehicle ahead on the same way that it pays to catch up with."""
        best: tuple[float, str, SharedWay] | None = None
        for front in sorted(self._members):
            if front == rear or leads.get(front, rear) != rear or front in taken:
                continue
            way = self._way(rear, front, states)
            if way is not None and (best is None or way.between_m < best[0]):
                best = way.between_m, front, way
        if best is None:
            return None
        between_m, front, way = best
        cruise = min(self._desired_mps(rear), self._desired_mps(front))
        added = ETA_FOLLOWER - (ETA_LEADER if rear in leads else 0.0)
        added += 0.0 if self._members[front].mode == "following" else ETA_LEADER
        meeting = best_meeting(
            max(0.0, between_m - road.length_m(front) - followed_gap_m(self._step_s)),
            max(cruise, SLOWEST_MPS),
            lambda begin_m: way.open_beyond_m(begin_m, self._is_open),
            added,
        )
        return None if meeting is None else (front, meeting)

    def _command(self, states: States, contacts: Mapping[str, Contact]) -> dict[str, float]:
        """Speeds of the coming step, those of leaders before those of their followers."""
        caps: dict[str, float] = {}
        coming: dict[str, float] = {}

        def coming_mps(name: str) -> float:
            if name not in coming:
                v = states[name].speed_mps
                # Set first, so that a circle of vehicles ends here.
                coming[name] = max(0.0, v + road.acceleration_mps2(name) * self._step_s)
                coming[name] = told_mps(name, v, coming[name])
            return coming[name]

        def told_mps(name: str, v: float, expected: float) -> float:
            member, contact = self._members[name], contacts.get(name)
            desired = self._desired_mps(name)
            if member.yields > 0 and member.mode == "alone":
                slowest = v - 0.9 * coasting_mps2(v) * self._step_s
                caps[name] = max((1 - member.yields) * desired, slowest)
                return min(expected, caps[name])
            if member.mode == "alone" or contact is None:
                return expected
            motion = Motion(v, desired, contact.gap_m)
            if member.mode == "parting":
                caps[name] = parting_mps(motion, contact.ahead_mps, self._step_s)
            else:
                fastest = (1 + FASTER) * desired
                caps[name] = following_mps(motion, coming_mps(contact.ahead), fastest, self._step_s)
            return caps[name]

        for name in sorted(self._members):
            coming_mps(name)
        return caps

    def _told(
        self, states: States, contacts: Mapping[str, Contact], caps: dict[str, float]
    ) -> PlatoonStep:
        eta: dict[str, float] = {}
        tail_m: dict[str, float] = {}
        follows: list[str] = []
        turbulent: list[str] = []
        for platoon in self._platoons(contacts):
            leader, followers = platoon[0], platoon[1:]
            follows += followers
            tail_m[leader] = road.length_m(leader) + sum(
                contacts[name].gap_m + road.length_m(name) for name in followers
            )
            fast = [states[name].speed_mps >= SLOWEST_MPS for name in platoon]
            if fast[0] and fast[1]:
                eta[leader] = ETA_LEADER
            for number, name in enumerate(followers, 1):
                if fast[number - 1] and fast[number]:
                    eta[name] = ETA_FOLLOWER
        for name, contact in contacts.items():
            if self._members[name].mode == "alone" or contact.gap_m > self._close_m:
                continue
            if self._is_turbulent(states[name].segment):
                turbulent += [name, contact.ahead]
        return PlatoonStep(
            eta=eta,
            leads=frozenset(tail_m),
            follows=frozenset(follows),
            caps=caps,
            hurry={n: m.hurry for n, m in self._members.items() if m.hurry != 1},
            tail_m=tail_m,
            turbulent=frozenset(turbulent) & self._members.keys(),
        )
