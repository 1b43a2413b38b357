"""What is wrong with vehicles and orders, by the tracked fleet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Final

from dispatcher_daemon.fleet.tracking import (
    FRESH_NS,
    NO_PLACE,
    NOT_YET,
    Claim,
    FleetTracker,
    TrackedVehicle,
    lateness,
    lateness_s,
)
from dispatcher_daemon.planning.route_form import NO_VEHICLE
from dispatcher_daemon.planning.routes import NO_WAY, WINDOW_CLOSES
from dispatcher_daemon.service.alarms.conditions import STARTED_S, Condition
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
UNHEARD_S: Final = 60.0
"""A vehicle that has orders for so long and has never sent anything is told of, s."""
CLAIMS: Final = 5
"""Of so many disputed orders of a vehicle each has an alarm; one of the vehicle stands for the
others."""


def fleet_conditions(
    tracker: FleetTracker, unserved: Mapping[str, str], next_cycle: int, now_ns: int
) -> Iterator[Condition]:
    """What is wrong.

    Args:
        unserved: reason by stop that the last cycle could not plan. One that merely waits for the
            next free vehicle is not wrong.
    """
    for vehicle in tracker.vehicles.values():
        yield from _of_vehicle(vehicle, tracker, next_cycle, now_ns)
    yield from _disputed(tracker)
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
        elif order.vehicle is not None and not order.ended:
            holder = tracker.vehicles.get(order.vehicle)
            if holder is not None and holder.is_fresh(now_ns) and holder.left:
                continue  # it says where it is: `vehicle_late` tells of it, sooner
            if (text := lateness(order, tracker, now_ns)) is not None:
                yield Condition("order_late", f"order/{order.order}", text)


def fleet_lost(tracker: FleetTracker, started_ns: int, now_ns: int) -> Iterator[Condition]:
    """No vehicle of the fleet's file reports, on the bus or over the API, and one should: there is
    something to do, or none ever has. Vehicles that stand idle may be silent.
    """
    heard_ns = [one.answered_ns or 0 for one in tracker.vehicles.values() if one.listed]
    last_ns = max(heard_ns, default=now_ns)
    if now_ns - last_ns <= FRESH_NS or (last_ns and not _has_work(tracker)):
        return
    count = f"none of the {len(heard_ns)} vehicles" if len(heard_ns) > 1 else "the only vehicle"
    never = " does not report" if len(heard_ns) == 1 else " reports"
    when = f"the last was heard at {utc(last_ns)}" if last_ns else "none was ever heard"
    text = f"{count}{never}, {when}: nobody knows whether they drive"
    awaited = last_ns < started_ns and now_ns - started_ns <= STARTED_S * 1e9
    yield Condition("fleet_lost", "dispatcher", text, last_ns or started_ns, awaited=awaited)


def _has_work(tracker: FleetTracker) -> bool:
    """Whether a vehicle has orders, or an order is due."""
    return any(
        not tracker.unplanned.get(name, "").startswith(NOT_YET)
        for name, order in tracker.book.orders.items()
        if not order.ended
    )


def _disputed(tracker: FleetTracker) -> Iterator[Condition]:
    """What vehicles say of orders that does not count."""
    by_vehicle: dict[str, list[Claim]] = {}
    for claim in tracker.claims.disputed():
        by_vehicle.setdefault(claim.vehicle, []).append(claim)
    for name, claims in by_vehicle.items():
        for claim in claims[:CLAIMS]:
            subject = f"order/{claim.visit.stop}"
            yield Condition("service_disputed", subject, claim.text, claim.since_ns)
        if others := claims[CLAIMS:]:
            told = ", ".join(f"{one.visit.stop} ({one.reason})" for one in islice(others, CLAIMS))
            more = f" and {len(others) - CLAIMS} more" if len(others) > CLAIMS else ""
            text = f"{name} says the same of {len(others)} more orders: {told}{more}"
            since_ns = min(claim.since_ns for claim in others)
            yield Condition("service_disputed", f"vehicle/{name}", text, since_ns)


def _unserved(order: OrderRecord, reason: str, now_ns: int) -> str | None:
    """What is wrong with an open order; None: it waits, and there is time."""
    if reason.startswith(NOT_YET):
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


def _of_vehicle(
    vehicle: TrackedVehicle, tracker: FleetTracker, next_cycle: int, now_ns: int
) -> Iterator[Condition]:
    name, held = f"vehicle/{vehicle.id}", tracker.book.held_by(vehicle.id)
    if vehicle.left_out_until > next_cycle and vehicle.withdrawn is not None:
        gone = vehicle.withdrawn
        text = f"{gone.reason or 'it did not answer its plan'}; its orders go to others"
        yield Condition("plan_refused", name, text, gone.since_ns)
    position, accepted = vehicle.position, vehicle.accepted
    if position is not None and (share := position.braking_share) is not None:
        text = f"its last brakings came to {share:.0%} of what was declared: it keeps no close gap"
        yield Condition("brakes_weak", name, text)
    if accepted is None and not held:
        return
    if vehicle.answered_ns is None:
        since_ns = min(tracker.book.orders[order].since_ns for order in held)
        if now_ns - since_ns > UNHEARD_S * 1e9:
            text = f"it has {_orders(len(held))} since {utc(since_ns)}, and was never heard"
            yield Condition("vehicle_unheard", name, text, since_ns)
    elif not vehicle.is_fresh(now_ns):
        where = "" if position is None else f" on {position.segment}"
        plan = "" if accepted is None else f"the plan of cycle {accepted.plan.cycle} and "
        heard = f"last heard of at {utc(vehicle.answered_ns)}{where}"
        text = f"{heard}; it has {plan}{_orders(len(held))}"
        yield Condition("vehicle_silent", name, text, vehicle.answered_ns)
    elif (late := lateness_s(vehicle, now_ns)) is not None and late[1] > LATE_S:
        stop, late_s = late
        text = f"expected at {stop} {late_s / 60:.0f} min after its window has closed"
        yield Condition("vehicle_late", name, text)


def _orders(count: int) -> str:
    return f"{count} order{'' if count == 1 else 's'}"
