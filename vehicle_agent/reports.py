"""What a vehicle tells the dispatcher unasked: where it is, and what became of its stops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from slipstream.messages import (
    Message,
    VehiclePosition,
    VehicleSensing,
    position_key,
    progress_key,
)
from vehicle_agent.tour import Tour

Outgoing = tuple[str, Message]
"""Key and message."""

_POSITION_NS: Final = 1_000_000_000
_PROGRESS_NS: Final = 5_000_000_000


class Reports:
    """Position and progress of one vehicle, as often as they are wanted."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._position_ns = self._progress_ns = 0

    def due(
        self,
        tour: Tour,
        sensing: VehicleSensing,
        now_ns: int,
        braking_share: float | None,
        *,
        changed: bool,
    ) -> Iterator[Outgoing]:
        """Position once a second, progress every five; both where it has left or come to a stop, or
        has another leg or plan.

        Args:
            braking_share: as in VehiclePosition.
        """
        if changed or now_ns - self._position_ns >= _POSITION_NS:
            self._position_ns = now_ns
            yield position_key(self._vehicle), _position(tour, sensing, braking_share)
        if changed or now_ns - self._progress_ns >= _PROGRESS_NS:
            yield from self.progress(tour, now_ns)

    def progress(self, tour: Tour, now_ns: int) -> Iterator[Outgoing]:
        """Progress, now."""
        self._progress_ns = now_ns
        yield progress_key(self._vehicle), tour.progress(now_ns)


def _position(tour: Tour, sensing: VehicleSensing, braking_share: float | None) -> VehiclePosition:
    share = 1.0  # it stands at the end of the segment that it came by
    if sensing.on_road:
        leg, state = tour.current, tour.state
        if leg is not None and state is not None:
            share = 1.0 if state.crossing else state.front_m / leg.lengths_m[state.number]
    return VehiclePosition(
        vehicle=tour.vehicle,
        time_ns=sensing.time_ns,
        segment=sensing.segment,
        share=min(1.0, max(0.0, share)),
        speed_mps=sensing.speed_mps,
        on_road=sensing.on_road,
        cycle=None if tour.plan is None else tour.plan.cycle,
        leg=None if tour.plan is None else tour.leg,
        charge_kwh=sensing.charge_kwh,
        braking_share=braking_share,
    )
