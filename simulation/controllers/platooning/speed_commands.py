"""Speeds of those that follow or part, and speed factors of those that hurry or wait."""

from __future__ import annotations

from simulation.controllers.platooning import road
from simulation.controllers.platooning.gap_control import (
    coasting_mps2,
    following_mps,
    parting_mps,
    waiting_mps,
)
from simulation.controllers.platooning.member import Member
from simulation.controllers.platooning.rendezvous import FASTER
from simulation.controllers.platooning.snapshot import Scene


def set_factors(scene: Scene) -> None:
    """Set the speed factors of the step.

    Those who wait get a lower one, not a command: under a command SUMO brakes no harder than
    comfortably, not even at signals.
    """
    for name, member in scene.members.items():
        hurry = _hurry(scene, name, member)
        if hurry != member.hurry:
            member.hurry = hurry
            road.set_speed_factor(name, member.factor * hurry)


def _hurry(scene: Scene, name: str, member: Member) -> float:
    if member.mode == "following":
        return 1 + FASTER
    if member.mode == "parting" or (member.gains <= 0 and member.yields <= 0):
        return 1.0
    if member.gains > 0:
        return 1 + member.gains
    desired_mps = scene.desired_mps(name)
    target_mps = (1 - member.yields) * desired_mps
    waiting = waiting_mps(scene.states[name].speed_mps, target_mps, scene.step_s)
    return min(1.0, waiting / desired_mps)


def commanded_mps(scene: Scene) -> dict[str, float]:
    """Speeds at the end of the step of those that follow or part."""
    return _Commands(scene).all()


class _Commands:
    """Commands of one step, each after that of the vehicle ahead."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._caps: dict[str, float] = {}
        self._coming: dict[str, float] = {}

    def all(self) -> dict[str, float]:
        for name, member in self._scene.members.items():
            if member.mode != "alone":
                self._coming_mps(name)
        return self._caps

    def _coming_mps(self, name: str) -> float:
        """Speed that a vehicle will have: commanded, or going on as in the last step."""
        if name not in self._coming:
            scene = self._scene
            now_mps = scene.states[name].speed_mps if name in scene.states else road.speed_mps(name)
            goes_on = max(0.0, now_mps + road.acceleration_mps2(name) * scene.step_s)
            # Set before the others are asked, so that a ring of vehicles ends here.
            self._coming[name] = goes_on
            cap = self._cap_mps(name, now_mps) if name in scene.members else None
            if cap is not None:
                self._caps[name] = self._coming[name] = cap
        return self._coming[name]

    def _cap_mps(self, name: str, now_mps: float) -> float | None:
        scene = self._scene
        member, contact = scene.members[name], scene.contacts.get(name)
        if member.mode == "alone":
            return None
        if contact is None:
            return min(now_mps + coasting_mps2(now_mps) * scene.step_s, scene.desired_mps(name))
        motion = scene.motion(name)
        coming_mps = self._coming_mps(contact.ahead)
        if member.mode == "parting":
            return parting_mps(motion, contact.ahead_mps, coming_mps, scene.step_s)
        fastest_mps = (1 + FASTER) * motion.desired_mps
        return following_mps(motion, contact.ahead_mps, coming_mps, fastest_mps, scene.step_s)
