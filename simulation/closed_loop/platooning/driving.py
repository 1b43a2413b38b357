"""Speeds of those that follow, part or wait, in the coming step."""

from __future__ import annotations

from simulation.closed_loop.platooning import road
from simulation.closed_loop.platooning.meeting import FASTER
from simulation.closed_loop.platooning.scene import Scene
from simulation.closed_loop.platooning.spacing import (
    coasting_mps2,
    following_mps,
    parting_mps,
    waiting_mps,
)


def commanded_mps(scene: Scene) -> dict[str, float]:
    """Speeds at the end of the step, by vehicle; those that nobody commands are left out."""
    return _Commands(scene).all()


class _Commands:
    """Commands of one step, each after that of the vehicle ahead."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._caps: dict[str, float] = {}
        self._coming: dict[str, float] = {}

    def all(self) -> dict[str, float]:
        for name, member in self._scene.members.items():
            if member.mode != "alone" or member.yields > 0:
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
                self._caps[name] = cap
                commanded = scene.members[name].mode != "alone"
                self._coming[name] = cap if commanded else min(cap, goes_on)
        return self._coming[name]

    def _cap_mps(self, name: str, now_mps: float) -> float | None:
        scene = self._scene
        member, contact = scene.members[name], scene.contacts.get(name)
        if member.mode == "alone":
            if member.yields <= 0:
                return None
            return waiting_mps(now_mps, (1 - member.yields) * scene.desired_mps(name), scene.step_s)
        if contact is None:
            return min(now_mps + coasting_mps2(now_mps) * scene.step_s, scene.desired_mps(name))
        motion = scene.motion(name)
        coming_mps = self._coming_mps(contact.ahead)
        if member.mode == "parting":
            return parting_mps(motion, contact.ahead_mps, coming_mps, scene.step_s)
        fastest_mps = (1 + FASTER) * motion.desired_mps
        return following_mps(motion, contact.ahead_mps, coming_mps, fastest_mps, scene.step_s)
