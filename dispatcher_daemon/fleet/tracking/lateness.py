"""Orders and vehicles judged by the clock: what is late, and whose time cannot be relied on."""

from __future__ import annotations

from typing import Final

from dispatcher_daemon.fleet.tracking.committing import behind_s
from dispatcher_daemon.fleet.tracking.plan_life import ANSWER_NS
from dispatcher_daemon.fleet.tracking.tracker import FleetTracker
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from slipstream.orders import OrderRecord, utc

OVERDUE_NS: Final = 300 * 10**9
"""An order that nobody has served so long after its planned arrival is late."""


def at_risk(order: OrderRecord, tracker: FleetTracker, now_ns: int) -> str | None:
    """Why nobody knows when an order that has a vehicle will be served, or why it is late; None: it
    is on time as far as is known, or has no vehicle.
    """
    claim = tracker.claims.of_order(order.order)
    if claim is not None and not order.ended:
        return claim.text
    vehicle = None if order.vehicle is None else tracker.vehicles.get(order.vehicle)
    if vehicle is None or order.state not in ("planned", "under_way"):
        return None
    late = lateness(order, tracker, now_ns)
    doubt = _doubt(order, vehicle, now_ns)
    return "; ".join(part for part in (doubt, late) if part is not None) or None


def lateness(order: OrderRecord, tracker: FleetTracker, now_ns: int) -> str | None:
    """By how much an order that has a vehicle is late by the clock, in words; None: it is not, or
    is being served.
    """
    vehicle = None if order.vehicle is None else tracker.vehicles.get(order.vehicle)
    if vehicle is None or order.state not in ("planned", "under_way"):
        return None
    visits = () if vehicle.progress is None else vehicle.progress.visits
    if any(visit.stop == order.order and visit.status == "arrived" for visit in visits):
        return None
    if order.latest_ns is not None and now_ns > order.latest_ns:
        return f"its window closed at {utc(order.latest_ns)}, and it is not served"
    arrival_ns = tracker.arrival_ns(order)
    if arrival_ns is not None and now_ns > arrival_ns + OVERDUE_NS:
        return f"{vehicle.id} was to be there at {utc(arrival_ns)}, and it is not served"
    return None


def lateness_s(vehicle: TrackedVehicle, now_ns: int) -> tuple[str, float] | None:
    """The stop ahead whose window a vehicle misses by most, and by how much, s; None: it keeps all.

    What it is behind now it is behind at each stop, less what the plan waits before.
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


def _doubt(order: OrderRecord, vehicle: TrackedVehicle, now_ns: int) -> str | None:
    """Why a vehicle's plan may not be what it does."""
    if vehicle.answered_ns is None:
        return (
            f"{vehicle.id} was never heard: it is planned since {utc(order.since_ns)}, and its "
            "time moves on with each cycle"
        )
    if not vehicle.is_fresh(now_ns):
        return f"{vehicle.id} is silent since {utc(vehicle.answered_ns)}"
    offered, accepted = vehicle.offered, vehicle.accepted
    if accepted is not None and any(s.stop == order.order for s in accepted.plan.stops):
        return None
    if offered is not None and now_ns - offered.since_ns > ANSWER_NS:
        return f"{vehicle.id} has not acknowledged the plan of cycle {offered.plan.cycle}"
    return None
