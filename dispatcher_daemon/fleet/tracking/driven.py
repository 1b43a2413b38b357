"""What vehicles have driven of the plans that they follow, for the energy ledger."""

from __future__ import annotations

from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from slipstream.energy.ledger import EnergyHour, driven, index_on_leg, merged, replaced_at
from slipstream.orders import PlanRecord


class DrivenBook:
    """Books plans as far as their vehicles say that they have driven them.

    Only a plan that was accepted counts: what a vehicle does that says nothing is not known.
    """

    def __init__(self) -> None:
        self._pending: list[EnergyHour] = []

    @property
    def pending(self) -> tuple[EnergyHour, ...]:
        """What was booked since `stored` was called last."""
        self._pending = merged(self._pending)
        return tuple(self._pending)

    def stored(self) -> None:
        """What was pending is in the database."""
        self._pending = []

    def advance(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        """Book a vehicle's plan up to the place that it has reported."""
        accepted, position = vehicle.accepted, vehicle.position
        if accepted is None or position is None or not vehicle.left:
            return
        plan = accepted.plan
        if position.cycle != plan.cycle:
            return
        place: float = sum(segment.leg < vehicle.leg for segment in plan.segments)
        if position.on_road:
            at = index_on_leg(plan.segments, vehicle.leg, position.segment, now_ns)
            if at is not None:
                place = at + position.share
        self._book(vehicle, accepted, place, now_ns)

    def replace(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        """A vehicle accepts the plan on offer: the one that it had is booked up to where that
        begins, and that from where the old one was booked to.
        """
        accepted, offered = vehicle.accepted, vehicle.offered
        assert offered is not None
        before = vehicle.booked
        vehicle.booked = 0.0
        if accepted is None or offered.plan.continues != accepted.plan.cycle:
            return
        begin = 0.0 if offered.energy is None else offered.energy.begin
        place = replaced_at(accepted.plan, offered.plan, begin, vehicle.leg)
        if place is not None:
            vehicle.booked = before
            self._book(vehicle, accepted, place, now_ns)
            vehicle.booked = max(0.0, vehicle.booked - place + begin)

    def finish(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        """A tour has ended: its last leg is booked, if the vehicle was seen on it."""
        accepted = vehicle.accepted
        assert accepted is not None
        if vehicle.left and vehicle.leg >= len(accepted.plan.stops) - 2:
            self._book(vehicle, accepted, len(accepted.plan.segments), now_ns)
        vehicle.booked = 0.0

    def _book(self, vehicle: TrackedVehicle, record: PlanRecord, place: float, now_ns: int) -> None:
        if place <= vehicle.booked:
            return
        if record.energy is not None:
            self._pending += driven(record.plan, record.energy, vehicle.booked, place, now_ns)
        vehicle.booked = place
