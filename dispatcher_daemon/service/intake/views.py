"""Orders as callers are told of them."""

from __future__ import annotations

from collections.abc import Iterable

from dispatcher_daemon.fleet import to_node_m
from dispatcher_daemon.fleet.tracking import FleetTracker, at_risk
from slipstream.messages import OrderReceipt, OrderRequest, OrderStatus, OrderStep
from slipstream.orders import OrderChange, OrderRecord
from slipstream.roads import RoadNetwork


def receipt_of(order: OrderRecord, network: RoadNetwork) -> OrderReceipt:
    """What its caller gets for an order, however often it is sent."""
    assert order.received_ns is not None
    request = request_of(order)
    away_m = None if request is None else to_node_m(network, request.lat, request.lon, order.node)
    return OrderReceipt(
        order=order.order,
        received_ns=order.received_ns,
        node=order.node,
        distance_m=None if away_m is None else round(away_m, 1),
        state=order.state,
    )


def status_of(order: OrderRecord, tracker: FleetTracker | None, now_ns: int) -> OrderStatus:
    """An order as it is now."""
    own = {name: getattr(order, name) for name in OrderStatus.model_fields if hasattr(order, name)}
    own |= {"request": request_of(order)}
    if tracker is not None:
        own |= {
            "arrival_ns": tracker.arrival_ns(order),
            "unplanned": tracker.unplanned.get(order.order) if order.state == "open" else None,
            "at_risk": at_risk(order, tracker, now_ns),
        }
    return OrderStatus(**{"arrival_ns": None, "unplanned": None, **own})


def request_of(order: OrderRecord) -> OrderRequest | None:
    """As it came; None: it is the file's."""
    # A tuple is a list in JSON.
    return (
        None if order.request is None else OrderRequest.model_validate(order.request, strict=False)
    )


def steps_of(stored: Iterable[OrderChange], pending: Iterable[OrderChange]) -> list[OrderStep]:
    """An order's life. What was pending may have been stored since it was looked up."""
    known = list(stored)
    known += [change for change in pending if change not in known]
    return [
        OrderStep(**{name: getattr(change, name) for name in OrderStep.model_fields})
        for change in known
    ]
