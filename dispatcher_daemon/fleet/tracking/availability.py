"""Which vehicles a cycle may plan, and why not the others."""

from __future__ import annotations

from typing import Final

from dispatcher_daemon.fleet.tracking.sightings import is_at
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from slipstream.roads import RoadNetwork

RESUME_NS: Final = 10 * 10**9
"""After a start, vehicles have this long to report before they count as never reporting."""


class Availability:
    """Judges vehicles by what they have reported."""

    def __init__(self, network: RoadNetwork, started_ns: int) -> None:
        self._network, self._started_ns = network, started_ns

    def obstacle(self, vehicle: TrackedVehicle, cycle: int, now_ns: int) -> str | None:
        """Why a vehicle is not planned; None: it is."""
        if not vehicle.has_telemetry:
            return "has a plan of the run before" if self.may_be_gone(vehicle, now_ns) else None
        if not vehicle.is_fresh(now_ns):
            return "silent"
        if vehicle.offered is not None:
            return "has not answered its plan yet"
        if cycle < vehicle.left_out_until:
            return "refused its plan, or did not answer it"
        assert vehicle.position is not None
        if vehicle.accepted is not None:
            if vehicle.position.cycle not in (None, vehicle.accepted.plan.cycle):
                return "follows another plan than it has acknowledged"
            if vehicle.free_since_ns is not None:
                return "is about to leave, or its last visits are not known yet"
            if vehicle.keeps_its_plan:
                return "is on its way to charge or to a hub, or stands there"
            return None
        if not self.is_free(vehicle):
            return "follows a plan that is not known, or is not at its depot"
        return None

    def is_free(self, vehicle: TrackedVehicle) -> bool:
        """Whether it stands at its depot and follows no plan but one that was taken back."""
        assert vehicle.position is not None
        withdrawn = None if vehicle.withdrawn is None else vehicle.withdrawn.plan.cycle
        return vehicle.position.cycle in (None, withdrawn) and self.is_home(vehicle)

    def is_home(self, vehicle: TrackedVehicle) -> bool:
        """Whether it stands at its depot."""
        position = vehicle.position
        if position is None or position.on_road:
            return False
        return is_at(self._network, position, vehicle.depot.node)

    def may_be_gone(self, vehicle: TrackedVehicle, now_ns: int) -> bool:
        """Whether it may have left by a plan of the run before, and have had no time to say so."""
        return (
            vehicle.offered is not None
            and vehicle.offered.since_ns < self._started_ns
            and now_ns - self._started_ns < RESUME_NS
        )
