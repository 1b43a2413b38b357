"""Snapshot of the fleet in one step: positions, vehicles ahead, platoons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import simulation.controllers.platooning.road as road
from simulation.controllers.platooning.gap_control import Motion, close_gap_m
from simulation.controllers.platooning.member import Contact, Member
from simulation.controllers.platooning.shared_path import PathPosition, SharedPath, find_shared_path
from simulation.controllers.vehicle import VehicleState

MAX_DISTANCE_M: Final = 2000.0
"""Largest distance of a rendezvous."""

_NEAR_SEGMENTS: Final = 3


@dataclass(frozen=True)
class FleetSnapshot:
    """Input of one step's decisions.

    Attributes:
        now_s: since midnight.
        step_s: of the simulation.
        members: by SUMO id, in a fixed order.
        states: theirs.
        lengths: of segments, m.
        is_open: whether a segment's gate is.
        limits: of segments, m/s, as far as they were asked for.
        contacts: vehicle directly ahead of members, as far as read.
    """

    now_s: float
    step_s: float
    members: Mapping[str, Member]
    states: Mapping[str, VehicleState]
    lengths: Mapping[str, float]
    is_open: Callable[[str], bool]
    limits: dict[str, float]
    contacts: dict[str, Contact] = field(default_factory=dict)
    _positions: dict[str, PathPosition] = field(default_factory=dict)

    def read_contacts(self, *, all_members: bool) -> None:
        """Read vehicles ahead from SUMO: of platoon members, or of all that may be behind one."""
        on = Counter(state.segment for state in self.states.values()) if all_members else None
        for name, member in self.members.items():
            if member.mode != "alone" or (on is not None and self._may_follow(name, on)):
                found = road.ahead(name)
                if found is not None:
                    self.contacts[name] = Contact(*found, road.speed_mps(found[0]))

    def _may_follow(self, name: str, on: Counter[str]) -> bool:
        number = self.states[name].number
        near = self.members[name].order.path[number : number + _NEAR_SEGMENTS]
        return sum(on[segment] for segment in near) > 1

    def shared_path(self, rear: str, front: str) -> SharedPath | None:
        """The path that two vehicles share; None where there is none."""
        return find_shared_path(
            self._position(rear), self._position(front), self.lengths, MAX_DISTANCE_M
        )

    def _position(self, name: str) -> PathPosition:
        place = self._positions.get(name)
        if place is None:
            member = self.members[name]
            place = PathPosition(member.order.path, member.numbers, self.states[name])
            self._positions[name] = place
        return place

    def desired_mps(self, name: str) -> float:
        """Speed that a vehicle would drive here without its catch-up factor."""
        return road.desired_mps(name) / self.members[name].speed_scale

    def limit_mps(self, segment: str) -> float:
        """Speed limit of a segment."""
        if segment not in self.limits:
            self.limits[segment] = road.limit_mps(segment)
        return self.limits[segment]

    def motion(self, name: str) -> Motion:
        """Of a vehicle that is behind another one."""
        return Motion(
            self.states[name].speed_mps, self.desired_mps(name), self.contacts[name].gap_m
        )

    @cached_property
    def platoons(self) -> tuple[tuple[str, ...], ...]:
        """Leaders with their close followers, front to back."""
        close_m = close_gap_m(self.step_s)
        behind = {
            contact.ahead: name
            for name, contact in self.contacts.items()
            if contact.gap_m <= close_m
            and self.members[name].mode == "following"
            and self.members[name].ahead == contact.ahead
        }
        if not behind:
            return ()
        platoons = []
        for leader in sorted(behind.keys() - set(behind.values())):
            platoon = [leader]
            while platoon[-1] in behind:
                platoon.append(behind[platoon[-1]])
            platoons.append(tuple(platoon))
        return tuple(platoons)
