"""What platooning asks of the agent, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from slipstream.messages import PlatoonControl, PlatoonManagement, PlatoonMode


class Gates(Protocol):
    """What the latest states say of segments."""

    def is_open(self, segment: str) -> bool:
        """Whether a close gap is allowed: the state is fresh and says stable traffic."""
        ...

    def is_turbulent(self, segment: str) -> bool:
        """Whether the traffic there is turbulent: a platoon parts until it has left the segment."""
        ...


@dataclass(frozen=True, slots=True)
class PlatoonStep:
    """A vehicle's platooning in the coming interval.

    Attributes:
        mode: who keeps the gap.
        speed_mps: to drive at the end of the interval; None while alone.
        cruise_mps: highest set speed while alone, lowered for a vehicle that catches up, or raised,
            up to the limit, to catch up; None: as without platooning.
        lead_mps: to drive at the end of the interval, of a leader on a road without signals; None
            of others.
        acceleration_mps2: to be driven from now on, with `speed_mps` or `lead_mps`; None: neither.
        gap_m: wanted gap to the vehicle ahead; None while alone.
        lane: wanted; None: as the driver likes. Whether it leads on is for the vehicle to say.
        partner: vehicle that it follows, opens its gap to, catches up with, or waits for.
        tail_m: from its front to the rear of its last follower in a close gap.
        close: whether it is in a close gap now.
        reason: why a platoon ended or does not form; None: neither.
        control: to be published now, keyed by the segment that it is on.
        messages: to be sent now.
        distrusts: why another vehicle, named first, is not believed for an hour from now on.
    """

    mode: PlatoonMode
    speed_mps: float | None
    cruise_mps: float | None
    lead_mps: float | None
    acceleration_mps2: float | None
    gap_m: float | None
    lane: int | None
    partner: str | None
    tail_m: float
    close: bool
    reason: str | None
    control: PlatoonControl
    messages: tuple[PlatoonManagement, ...]
    distrusts: str | None = None
