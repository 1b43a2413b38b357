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
        follows: vehicles whose speed platooning commands: close behind another one of the fleet,
            closing up to it, or opening the gap. No other advice is for them.
        caps: the speeds that those are to be driven at (`setSpeed`), m/s.
        hurry: factor on a vehicle's own speed factor: above 1 while it follows or catches up, below
            1 while it waits. Platooning has set it in SUMO already, and takes it back.
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
