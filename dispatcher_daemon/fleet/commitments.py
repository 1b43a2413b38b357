"""What a vehicle that has acknowledged a plan is bound to: its place, next segments and stops."""

from __future__ import annotations

from dataclasses import dataclass

from slipstream.messages import VehiclePlan


@dataclass(frozen=True)
class Moving:
    """A vehicle's place on its first committed segment.

    Attributes:
        share: of the segment that lies behind it.
    """

    share: float
    speed_mps: float
    time_ns: int


@dataclass(frozen=True)
class CommittedLeg:
    """The part of a leg that can no longer be changed.

    Attributes:
        path: its segments in order, the one that the vehicle is on first; none: any path may do.
    """

    path: tuple[str, ...]
    complete: bool


@dataclass(frozen=True)
class Commitment:
    """What the next plan of a vehicle with an acknowledged one has to keep to.

    It begins with ``place``, drives the committed legs first, and serves exactly ``stops``.

    Attributes:
        place: stop or depot that it left last, or stands at.
        ends_ns: when service there ends, or has ended, UTC; not used of one that moves.
        departs_ns: when its plan has it leave, later where it waits for others; likewise.
        moving: where it is on its first committed segment; None: it stands at the place.
        legs: of which something is fixed, at least one; the leg of number i ends at stop i, or at
            the depot after all stops. They fix the order of their stops.
        stops: that it has loaded and not visited, in the order of its plan.
        under_way: whether it has left its depot; else its next plan begins there too.
        lost: True if it does not follow the plan any more, and needs one whatever has changed.
    """

    vehicle: str
    plan: VehiclePlan
    place: str
    node: str
    arrived_ns: int
    ends_ns: int
    departs_ns: int
    moving: Moving | None
    legs: tuple[CommittedLeg, ...]
    stops: tuple[str, ...]
    under_way: bool = True
    lost: bool = False

    @property
    def may_wait(self) -> bool:
        """Whether it stands at a stop and could stay there longer."""
        return self.under_way and self.moving is None and not self.legs[0].path

    @property
    def continues(self) -> int | None:
        """`VehiclePlan.continues` of its next plan."""
        return self.plan.cycle if self.under_way else None

    @property
    def fixed_stops(self) -> tuple[str, ...]:
        """The stops whose order is fixed."""
        return self.stops[: len(self.legs)]
