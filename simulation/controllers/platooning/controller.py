"""Platoons of the fleet in the running simulation, from step to step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import simulation.controllers.platooning.road as road
from simulation.controllers.platooning.catch_up import assign_catch_ups
from simulation.controllers.platooning.gap_control import MIN_SPEED_MPS, close_gap_m
from simulation.controllers.platooning.join_leave import decide, disengage
from simulation.controllers.platooning.member import Member
from simulation.controllers.platooning.snapshot import FleetSnapshot
from simulation.controllers.platooning.speed_commands import commanded_mps, set_speed_factors
from simulation.controllers.vehicle import LegOrder, VehicleState
from slipstream.energy import ETA_FOLLOWER, ETA_LEADER

_JOIN_EVERY_S: Final = 1.0
_CATCH_UP_EVERY_S: Final = 2.0


@dataclass(frozen=True)
class PlatoonStep:
    """Platoons and their driving in the coming step, by SUMO id.

    Attributes:
        eta: drag reduction; vehicles that have none are left out.
        leads: leaders of platoons.
        follows: vehicles whose speed platooning commands: in a close gap, closing it, or opening
            it. They take no other advice.
        caps: their commanded speeds (`setSpeed`), m/s.
        speed_scale: factor on a vehicle's own speed factor: above 1 while it follows or catches
            up, below 1 while it waits. Platooning sets and resets it in SUMO itself.
        tail_m: of each leader, from its front to the rear of its last follower.
        turbulent: vehicles in a close gap on a segment whose true traffic is turbulent.
    """

    eta: Mapping[str, float] = field(default_factory=dict)
    leads: frozenset[str] = frozenset()
    follows: frozenset[str] = frozenset()
    caps: Mapping[str, float] = field(default_factory=dict)
    speed_scale: Mapping[str, float] = field(default_factory=dict)
    tail_m: Mapping[str, float] = field(default_factory=dict)
    turbulent: frozenset[str] = frozenset()


class Platooning:
    """Platoons of the fleet: catch up, join, keep a close gap where gates are open, leave.

    Two vehicles drive as a platoon where one is directly behind the other on its lane, both go the
    same way, the gates there are open, and the open distance ahead pays for the manoeuvre. The
    follower is then commanded (`following_mps`) under SUMO's safety checks; the leader keeps the
    car-following model that it has in every other arm. The drag reduction is that of the advised
    gap: in a simulation of steps of 0.5 s followers keep 3.75 m, and the gap of 1.5 m is given in
    the evaluation, not in the motion. It is credited for gaps of at most 7.5 m, at 5 m/s and more,
    behind an open gate.

    A disengagement is a platoon that opens its gaps because a segment under one of its vehicles has
    an open gate although its true traffic is turbulent. It is counted once per platoon. The
    followers do not close up again before they have left that segment.

    Args:
        open_segments: whether a segment's gate is open now.
        turbulent: whether a segment's true traffic is turbulent now.
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
        self._members: dict[str, Member] = {}
        self._limits: dict[str, float] = {}
        self._join_s = self._catch_up_s = 0.0
        self._disengagements = 0

    @property
    def disengagements(self) -> int:
        """Number of disengagements so far."""
        return self._disengagements

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle entered the road, or was rerouted on it."""
        if not self._enabled:
            return
        numbers = {segment: number for number, segment in enumerate(order.path)}
        if name in self._members:
            self._members[name].order = order
            self._members[name].numbers = numbers
        else:
            road.add_follower_type()
            self._members[name] = Member(order, numbers, road.speed_factor(name))

    def ended(self, name: str) -> None:
        """A vehicle left the road."""
        self._members.pop(name, None)

    def step(self, now_s: float, states: Mapping[str, VehicleState]) -> PlatoonStep:
        """Control the coming step in SUMO; the caller sets the speeds in `caps`."""
        members = self._members
        if len(members) < 2 and all(
            m.mode == "alone" and m.speed_scale == 1 for m in members.values()
        ):
            return PlatoonStep()
        joins = now_s >= self._join_s
        snapshot = FleetSnapshot(
            now_s, self._step_s, members, states, self._lengths, self._is_open, self._limits
        )
        snapshot.read_contacts(all_members=joins)
        self._disengagements += disengage(snapshot, self._is_turbulent)
        for name, member in members.items():
            if joins or member.mode != "alone":
                decide(snapshot, name)
        if joins:
            self._join_s = now_s + _JOIN_EVERY_S
        if now_s >= self._catch_up_s:
            self._catch_up_s = now_s + _CATCH_UP_EVERY_S
            assign_catch_ups(snapshot)
        set_speed_factors(snapshot)
        return self._platoon_step(snapshot, commanded_mps(snapshot))

    def _platoon_step(self, snapshot: FleetSnapshot, caps: dict[str, float]) -> PlatoonStep:
        # The platoons have changed since the disengagements.
        snapshot.__dict__.pop("platoons", None)
        eta: dict[str, float] = {}
        tail_m: dict[str, float] = {}
        for platoon in snapshot.platoons:
            leader, followers = platoon[0], platoon[1:]
            tail_m[leader] = road.length_m(leader) + sum(
                snapshot.contacts[name].gap_m + road.length_m(name) for name in followers
            )
            for front, name in zip(platoon, followers, strict=False):
                states = snapshot.states[front], snapshot.states[name]
                fast = min(state.speed_mps for state in states) >= MIN_SPEED_MPS
                if fast and self._is_open(states[1].segment):
                    eta[name] = ETA_FOLLOWER
                    if self._is_open(states[0].segment):
                        eta.setdefault(front, ETA_LEADER)
        return PlatoonStep(
            eta=eta,
            leads=frozenset(tail_m),
            follows=frozenset(n for n, m in self._members.items() if m.mode != "alone"),
            caps=caps,
            speed_scale={n: m.speed_scale for n, m in self._members.items() if m.speed_scale != 1},
            tail_m=tail_m,
            turbulent=self._exposed(snapshot),
        )

    def _exposed(self, snapshot: FleetSnapshot) -> frozenset[str]:
        """Vehicles in a close gap in truly turbulent traffic, leaving ones included."""
        exposed = []
        for name, contact in snapshot.contacts.items():
            member = snapshot.members[name]
            close = member.mode != "alone" and contact.gap_m <= close_gap_m(self._step_s)
            if close and contact.ahead in snapshot.members:
                pair = (name, contact.ahead)
                exposed += [n for n in pair if self._is_turbulent(snapshot.states[n].segment)]
        return frozenset(exposed)
