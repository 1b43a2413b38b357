"""Speed commands of following and leaving vehicles, and speed factors during catch-up."""

from __future__ import annotations

import simulation.controllers.platooning.road as road
from simulation.controllers.platooning.gap_control import (
    coasting_mps2,
    following_mps,
    leaving_mps,
    waiting_mps,
)
from simulation.controllers.platooning.member import Member
from simulation.controllers.platooning.rendezvous import MAX_SPEEDUP
from simulation.controllers.platooning.snapshot import FleetSnapshot


def set_speed_factors(snapshot: FleetSnapshot) -> None:
    """Set the speed factors of the step.

    A vehicle that slows down for another one gets a lower factor, not a speed command: under a
    command SUMO brakes no harder than comfortable, even at signals.
    """
    for name, member in snapshot.members.items():
        speed_scale = _speed_scale(snapshot, name, member)
        if speed_scale != member.speed_scale:
            member.speed_scale = speed_scale
            road.set_speed_factor(name, member.factor * speed_scale)


def _speed_scale(snapshot: FleetSnapshot, name: str, member: Member) -> float:
    if member.mode == "following":
        return 1 + MAX_SPEEDUP
    if member.mode == "leaving" or (member.speedup <= 0 and member.slowdown <= 0):
        return 1.0
    if member.speedup > 0:
        return 1 + member.speedup
    desired_mps = snapshot.desired_mps(name)
    target_mps = (1 - member.slowdown) * desired_mps
    waiting = waiting_mps(snapshot.states[name].speed_mps, target_mps, snapshot.step_s)
    return min(1.0, waiting / desired_mps)


def commanded_mps(snapshot: FleetSnapshot) -> dict[str, float]:
    """Commanded speeds of following and leaving vehicles at the end of the step, m/s."""
    return _Commands(snapshot).all()


class _Commands:
    """Commands of one step, each after that of the vehicle ahead."""

    def __init__(self, snapshot: FleetSnapshot) -> None:
        self._scene = snapshot
        self._caps: dict[str, float] = {}
        self._coming: dict[str, float] = {}

    def all(self) -> dict[str, float]:
        for name, member in self._scene.members.items():
            if member.mode != "alone":
                self._coming_mps(name)
        return self._caps

    def _coming_mps(self, name: str) -> float:
        """Speed at the end of the step: commanded, or extrapolated from the last step."""
        if name not in self._coming:
            snapshot = self._scene
            now_mps = (
                snapshot.states[name].speed_mps if name in snapshot.states else road.speed_mps(name)
            )
            goes_on = max(0.0, now_mps + road.acceleration_mps2(name) * snapshot.step_s)
            # Set before the recursion, which a ring of vehicles would never leave.
            self._coming[name] = goes_on
            cap = self._cap_mps(name, now_mps) if name in snapshot.members else None
            if cap is not None:
                self._caps[name] = self._coming[name] = cap
        return self._coming[name]

    def _cap_mps(self, name: str, now_mps: float) -> float | None:
        snapshot = self._scene
        member, contact = snapshot.members[name], snapshot.contacts.get(name)
        if member.mode == "alone":
            return None
        if contact is None:
            return min(
                now_mps + coasting_mps2(now_mps) * snapshot.step_s, snapshot.desired_mps(name)
            )
        motion = snapshot.motion(name)
        coming_mps = self._coming_mps(contact.ahead)
        if member.mode == "leaving":
            return leaving_mps(motion, contact.ahead_mps, coming_mps, snapshot.step_s)
        max_mps = (1 + MAX_SPEEDUP) * motion.desired_mps
        return following_mps(motion, contact.ahead_mps, coming_mps, max_mps, snapshot.step_s)
