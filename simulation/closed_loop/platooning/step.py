"""What platooning wants of the coming step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class PlatoonStep:
    """Platoons and their driving in the coming step, by SUMO id.

    Attributes:
        eta: drag reduction; vehicles that have none are left out.
        leads: at the front of a platoon, with somebody close behind.
        follows: close behind another vehicle of the fleet, at any speed.
        caps: speed to drive at most, m/s. Followers, and vehicles that open their gap, are to be
            driven at it (`setSpeed`), as no car-following model keeps their distance.
        hurry: factor on the vehicle's own speed factor, above 1 while it catches up or follows.
            Platooning has set it in SUMO already, and takes it back.
        tail_m: of each leader, from its front to the rear of its last follower.
        turbulent: close together on a segment whose traffic is turbulent in truth.
    """

    eta: Mapping[str, float] = field(default_factory=dict)
    leads: frozenset[str] = frozenset()
    follows: frozenset[str] = frozenset()
    caps: Mapping[str, float] = field(default_factory=dict)
    hurry: Mapping[str, float] = field(default_factory=dict)
    tail_m: Mapping[str, float] = field(default_factory=dict)
    turbulent: frozenset[str] = frozenset()
