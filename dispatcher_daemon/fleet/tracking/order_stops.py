"""Orders as stops of a cycle's fleet, and stops of the fleet's file as orders."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, Final

from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.stops import DEPOT, Stop
from slipstream.orders import OrderRecord, utc

OPENS_LATER: Final = "its window opens later"
BUNDLED: Final = "others may join it"
NOT_YET: Final = (OPENS_LATER, BUNDLED)
"""Begins of the reasons of orders that are not planned yet."""
NO_PLACE: Final = ("the network has no junction", "another place of the fleet's file has its id")
"""Begins of reasons for which an order has no place in any plan."""
_SLACK_SHARE: Final = 4
_DAY_S: Final = 86_400.0


def opened(stop: Stop, now_ns: int, reason: str) -> OrderRecord:
    """An order of the file that has just been found there."""
    return OrderRecord(
        order=stop.id,
        state="open",
        since_ns=now_ns,
        reason=reason,
        earliest_ns=None,
        latest_ns=None,
        node=stop.node,
        service_s=stop.service_s,
        demand=stop.demand,
    )


def details(stop: Stop, reference_ns: int) -> dict[str, Any]:
    """What the file says of an order, at the moment that the fleet's times count from."""
    earliest_ns, latest_ns = stop.window_ns(reference_ns)
    return {
        "node": stop.node,
        "service_s": stop.service_s,
        "demand": stop.demand,
        "earliest_ns": earliest_ns,
        "latest_ns": latest_ns,
    }


def stops_at(orders: Iterable[OrderRecord], reference_ns: int) -> Iterator[Stop]:
    """Orders as stops of a fleet whose times count from a moment. A window that has closed closes
    then: what is loaded is delivered late rather than not at all.
    """
    for order in orders:

        def after(time_ns: int) -> float:
            return max(0.0, 1e-9 * (time_ns - reference_ns))

        earliest_s = 0.0 if order.earliest_ns is None else after(order.earliest_ns)
        yield Stop(
            id=order.order,
            node=order.node,
            service_s=order.service_s,
            demand=order.demand,
            earliest_s=min(earliest_s, _DAY_S),
            latest_s=None
            if order.latest_ns is None
            else min(max(after(order.latest_ns), earliest_s), _DAY_S),
        )


def requested_stop(order: OrderRecord, reference_ns: int) -> Stop:
    """An order, with all that its caller asks for, as a stop of a fleet whose times count from a
    moment.
    """
    (stop,) = stops_at([order], reference_ns)
    asked = order.request
    if asked is None:
        return stop
    return stop.model_copy(
        update={
            "mass_kg": asked["mass_kg"],
            "carrier": asked["carrier"],
            "skills": tuple(asked["skills"]),
            "vehicle": order.pinned,
        }
    )


def stop_of(order: OrderRecord, fleet: Fleet | None, reference_ns: int) -> Stop:
    """An order with its absolute window; of one of the file, the file knows the rest."""
    stop = requested_stop(order, reference_ns)
    listed = None if fleet is None else fleet.stop_by_id.get(order.order)
    if order.request is not None or listed is None:
        return stop
    times = {"earliest_s": stop.earliest_s, "latest_s": stop.latest_s}
    return listed.model_copy(update={**times, "vehicle": order.pinned or listed.vehicle})


def outside_windows(fleet: Fleet, reference_ns: int, ahead_s: float) -> dict[str, str]:
    """Stops of the file whose window by the clock is far ahead or has closed, with the reason; as
    of callers' orders.
    """
    found = {}
    for stop in fleet.stops:
        if stop.earliest is not None and stop.earliest_s > ahead_s:
            begins = utc(reference_ns + round(1e9 * (stop.earliest_s - ahead_s)))
            found[stop.id] = f"{OPENS_LATER}: it is planned from {begins} on"
        elif stop.latest is not None and stop.latest_s == 0:
            found[stop.id] = "its window closes before a plan can be out"
    return found


def is_bundled(order: OrderRecord, reference_ns: int, bundle_s: float) -> bool:
    """Whether an order that no vehicle has may wait for others still."""
    return order.state == "open" and _bundled_until_ns(order, bundle_s) > reference_ns


def _bundled_until_ns(order: OrderRecord, bundle_s: float) -> int:
    received_ns = order.received_ns
    return 0 if received_ns is None else bundled_until_ns(received_ns, order.latest_ns, bundle_s)


def bundled_until_ns(received_ns: int, latest_ns: int | None, bundle_s: float) -> int:
    """When an order is planned that may wait for others: at the next multiple of a time since 1970,
    but before a quarter of the time to its window's end has passed.

    Orders of one vehicle trip have to be known together; each alone needs a trip of its own.
    """
    bundle_ns = round(1e9 * bundle_s)
    if bundle_ns == 0:
        return received_ns
    until_ns = -(-received_ns // bundle_ns) * bundle_ns
    if latest_ns is None:
        return until_ns
    return min(until_ns, received_ns + max(0, latest_ns - received_ns) // _SLACK_SHARE)


def requested_stops(
    orders: Iterable[OrderRecord],
    may_plan: Callable[[str], bool],
    fleet: Fleet | None,
    junctions: Collection[str],
    reference_ns: int,
    ahead_s: float,
    bundle_s: float,
) -> tuple[list[Stop], dict[str, str]]:
    """(callers' orders as stops of a cycle, why others that are open are not among them)."""
    places = _places(fleet)
    found, kept = list[Stop](), dict[str, str]()
    for order in orders:
        if order.request is None or order.ended or not may_plan(order.order):
            continue
        opens_ns = order.earliest_ns or 0
        if order.node not in junctions:
            kept[order.order] = f"{NO_PLACE[0]} {order.node!r}"
        elif order.order in places:
            kept[order.order] = NO_PLACE[1]
        elif opens_ns > reference_ns + round(1e9 * ahead_s):
            begins = utc(opens_ns - round(1e9 * ahead_s))
            kept[order.order] = f"{OPENS_LATER}: it is planned from {begins} on"
        elif order.latest_ns is not None and order.latest_ns <= reference_ns:
            kept[order.order] = "its window closes before a plan can be out"
        elif is_bundled(order, reference_ns, bundle_s):
            begins = utc(_bundled_until_ns(order, bundle_s))
            kept[order.order] = f"{BUNDLED}: it is planned from {begins} on"
        else:
            found.append(requested_stop(order, reference_ns))
    return found, kept


def _places(fleet: Fleet | None) -> frozenset[str]:
    """Names of a fleet's places that are no stops."""
    if fleet is None:
        return frozenset({DEPOT})
    tables = fleet.depot_by_id, fleet.charging_stop_by_id, fleet.hub_by_id
    return frozenset({DEPOT}).union(*tables, fleet.break_ids)
