"""State of a vehicle of the fleet in platooning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from simulation.controllers.vehicle import LegOrder

Mode = Literal["alone", "following", "leaving"]
"""Speed control of a vehicle. alone: by its car-following model. following: by platooning, in or
closing a close gap. leaving: by platooning, until the gap is wide enough for the model."""


@dataclass
class Member:
    """A vehicle on the road.

    Attributes:
        order: its leg.
        numbers: of its path's segments.
        factor: its own speed factor.
        mode: see `Mode`.
        ahead: vehicle of the fleet that it follows or last followed.
        since_s: begin of its mode.
        seen_s: when it was last seen directly behind another member.
        lane_until_s: end of the last command to keep its lane.
        speedup: share of its speed that it is added to catch up.
        slowdown: share of its speed that is taken off for a vehicle that catches up.
        speed_scale: factor on its speed factor that is set.
        disengaged_on: segment of its last disengagement, until it has left it.
    """

    order: LegOrder
    numbers: dict[str, int]
    factor: float
    mode: Mode = "alone"
    ahead: str | None = None
    since_s: float = 0.0
    seen_s: float = 0.0
    lane_until_s: float = 0.0
    speedup: float = 0.0
    slowdown: float = 0.0
    speed_scale: float = 1.0
    disengaged_on: str | None = None

    def set_mode(self, mode: Mode, now_s: float) -> None:
        """Take a mode."""
        self.mode, self.since_s = mode, now_s


@dataclass(frozen=True)
class Contact:
    """The vehicle directly ahead.

    Attributes:
        ahead: any vehicle.
        gap_m: from its front to that one's rear.
        ahead_mps: that one's speed.
    """

    ahead: str
    gap_m: float
    ahead_mps: float
