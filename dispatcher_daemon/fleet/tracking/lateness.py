"""By how much a vehicle will miss the windows of its stops."""

from __future__ import annotations

from dispatcher_daemon.fleet.tracking.committing import behind_s
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle


def lateness_s(vehicle: TrackedVehicle, now_ns: int) -> tuple[str, float] | None:
    """The stop ahead whose window a vehicle misses by most, and by how much, s; None: it keeps all.

    What it is behind now it is behind at each stop, less what the plan waits before.

    Args:
        vehicle: one that follows a plan.
        now_ns: UTC.
    """
    if vehicle.accepted is None or not vehicle.left:
        return None
    visits = () if vehicle.progress is None else vehicle.progress.visits
    visited = {visit.stop for visit in visits}
    late_s = max(0.0, behind_s(vehicle, now_ns))
    worst: tuple[str, float] | None = None
    for stop in vehicle.accepted.plan.stops[vehicle.leg + 1 :]:
        if stop.latest_ns is not None and stop.stop not in visited:
            expected_ns = max(now_ns, stop.arrival_ns + late_s * 1e9)
            missed_s = 1e-9 * (expected_ns - stop.latest_ns)
            if missed_s > 0 and (worst is None or missed_s > worst[1]):
                worst = stop.stop, missed_s
        late_s = max(0.0, late_s - stop.wait_s)
    return worst
