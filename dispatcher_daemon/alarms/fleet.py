"""What is wrong with vehicles and orders, by the tracked fleet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from dispatcher_daemon.alarms.conditions import Condition
from dispatcher_daemon.planning import NO_VEHICLE, NO_WAY, WINDOW_CLOSES
from dispatcher_daemon.tracking import (
    NO_PLACE,
    OPENS_LATER,
    FleetTracker,
    TrackedVehicle,
    lateness_s,
)
from slipstream.orders import OrderRecord, utc

FAILED_S: Final = 3600.0
"""A failed order is told of for so long, s."""
LATE_S: Final = 30.0
"""Later than this beyond its window a vehicle is late, s."""
FOR_GOOD: Final = (NO_WAY, WINDOW_CLOSES, *NO_PLACE)
"""Begins of reasons that no vehicle which comes back changes."""
CLOSES_S: Final = 900.0
"""An order that has no vehicle is told of so long before its window closes, s: after that no van is
called in time any more.
"""
WAITED_S: Final = 3600.0
"""An order without such a window may wait so long for a vehicle, s: tours of some stops in a city
take less, so that by then one should have come back for it.
"""


def fleet_conditions(
    tracker: FleetTracker, unserved: Mapping[str, str], next_cycle: int, now_ns: int
) -> Iterator[Condition]:
    """What is wrong.

    Args:
        tracker: of the fleet.
        unserved: reason by stop that the last cycle could not plan. One that merely waits for the
            next free vehicle is not wrong.
        next_cycle: its number.
        now_ns: UTC.
    """
    for vehicle in tracker.vehicles.values():
        yield from _of_vehicle(vehicle, next_cycle, now_ns)
    orders = tracker.book.orders
    # While a cycle runs the tracker has no reasons of it yet.
    reasons = {**unserved, **tracker.unplanned}
    for order in orders.values():
        if order.state == "failed" and now_ns - order.since_ns < FAILED_S * 1e9:
            yield Condition("order_failed", f"order/{order.order}", order.reason, order.since_ns)
        elif order.state == "open":
            reason = reasons.get(order.order, NO_VEHICLE)
            if (text := _unserved(order, reason, now_ns)) is not None:
                yield Condition("order_unserved", f"order/{order.order}", text)


def _unserved(order: OrderRecord, reason: str, now_ns: int) -> str | None:
    """What is wrong with an open order; None: it waits, and there is time."""
    if reason.startswith(OPENS_LATER):
        return None
    if reason.startswith(FOR_GOOD):
        return reason
    # Of a stop of the file the times here are those of a plan that it is not in any more.
    closes_ns = None if order.request is None else order.latest_ns
    if closes_ns is not None and closes_ns - now_ns < CLOSES_S * 1e9:
        return f"its window closes at {utc(closes_ns)}, and it has no vehicle: {reason}"
    opens_ns = 0 if order.request is None else order.earliest_ns or 0
    waits_ns = max(order.since_ns, opens_ns)
    if now_ns - waits_ns > WAITED_S * 1e9:
        return f"it has waited for a vehicle since {utc(waits_ns)}: {reason}"
    return None


def _of_vehicle(vehicle: TrackedVehicle, next_cycle: int, now_ns: int) -> Iterator[Condition]:
    name = f"vehicle/{vehicle.id}"
    if vehicle.left_out_until > next_cycle and vehicle.withdrawn is not None:
        gone = vehicle.withdrawn
        text = f"{gone.reason or 'it did not answer its plan'}; its orders go to others"
        yield Condition("plan_refused", name, text, gone.since_ns)
    accepted = vehicle.accepted
    if accepted is None:
        return
    if not vehicle.is_fresh(now_ns) and vehicle.answered_ns is not None:
        heard = f"last heard of at {utc(vehicle.answered_ns)}"
        text = f"{heard}; it has the plan of cycle {accepted.plan.cycle}"
        yield Condition("vehicle_silent", name, text, vehicle.answered_ns)
    elif (late := lateness_s(vehicle, now_ns)) is not None and late[1] > LATE_S:
        stop, late_s = late
        text = f"expected at {stop} {late_s / 60:.0f} min after its window has closed"
        yield Condition("vehicle_late", name, text)
