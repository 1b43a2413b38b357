"""Drag reductions by the gaps that vehicles of the fleet have in the running simulation.

They are measured, not told by agents. The reduction is that of the advised gap of 1.5 m: in steps
of 0.5 s followers keep 3.75 m and more, and the advised gap is given in the evaluation, not in the
motion. It is credited for gaps of at most 7.5 m, at 5 m/s and more, behind an open gate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from slipstream.energy import ETA_FOLLOWER, ETA_LEADER
from slipstream.messages import VehicleSensing
from vehicle_agent.platooning import CLOSE_GAP_M, MIN_SPEED_MPS


class Gates(Protocol):
    """Gate and true traffic of a segment."""

    def is_open(self, segment: str) -> bool:
        """Whether close gaps are allowed on it."""
        ...

    def is_turbulent(self, segment: str) -> bool:
        """Whether its true traffic is turbulent."""
        ...


@dataclass(frozen=True)
class Drafting:
    """Platooning in one step.

    Attributes:
        eta: drag reduction by vehicle; vehicles without one are left out.
        turbulent: vehicles in a close gap, leaving ones included, on segments whose true traffic is
            turbulent.
    """

    eta: Mapping[str, float] = field(default_factory=dict)
    turbulent: frozenset[str] = frozenset()


def drafting(
    sensed: Mapping[str, VehicleSensing],
    following: Mapping[str, bool],
    gates: Gates,
) -> Drafting:
    """The drag reductions of a step.

    Args:
        sensed: by vehicle, of all on the road.
        following: by vehicle whose gap its agent keeps: whether it follows, or leaves.
        gates: of the segments.
    """
    eta: dict[str, float] = {}
    exposed: set[str] = set()
    for name, follows in following.items():
        own = sensed[name]
        ahead = own.ahead
        if ahead is None or ahead.vehicle is None or ahead.gap_m > CLOSE_GAP_M:
            continue
        front = sensed.get(ahead.vehicle)
        if front is None:
            continue
        exposed.update(v.vehicle for v in (own, front) if gates.is_turbulent(v.segment))
        fast = min(own.speed_mps, front.speed_mps) >= MIN_SPEED_MPS
        if follows and fast and gates.is_open(own.segment):
            eta[name] = ETA_FOLLOWER
            if gates.is_open(front.segment):
                eta.setdefault(front.vehicle, ETA_LEADER)
    return Drafting(eta, frozenset(exposed))
