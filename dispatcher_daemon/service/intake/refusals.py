"""Refusals of what is asked for an order, with what can be done instead."""

from __future__ import annotations

from typing import Final

from slipstream.messages import OrderRefusal
from slipstream.orders import OrderRecord, OrderRefused

MAX_KNOWN: Final = 100_000
"""Orders that a dispatcher keeps in mind; callers cannot fill its memory."""


def conflict(order: OrderRecord) -> OrderRefusal:
    """An id that is known with another content."""
    problem, mend = "an order with this id is known, with other data", "give a new order a new id"
    if order.request is None:
        problem = "a stop of the fleet's file has this id"
    return OrderRefusal(order=order.order, kind="conflict", key="id", problem=problem, mend=mend)


def too_many(name: str) -> OrderRefusal:
    """An order for which there is no room."""
    problem, mend = f"{MAX_KNOWN} orders are known already", "send more when some have ended"
    return OrderRefusal(order=name, kind="unavailable", key=None, problem=problem, mend=mend)


def unknown(name: str) -> OrderRefused:
    """An id that nobody has submitted."""
    return OrderRefused("not_found", "no such order", "submit it first", order=name)


def too_late(order: OrderRecord) -> OrderRefused:
    """An order that has ended, or that its vehicle has accepted or left with."""
    problem = f"it is {order.state}: {order.reason}"
    mend = "submit another order"
    if order.state == "planned":
        problem = f"{order.vehicle} has accepted the plan with it"
        mend = "pin it to that vehicle, or wait until it is open again"
    elif order.state == "under_way":
        problem, mend = f"{order.vehicle} has left with it", "tell its driver"
    return OrderRefused("too_late", problem, mend, order=order.order)


def not_answered(order: OrderRecord) -> OrderRefused:
    """An order of a plan that its vehicle has been sent, and has not answered."""
    problem = f"{order.vehicle} has a plan with it, and has not answered yet"
    mend = "pin it to that vehicle, or wait until it is open again"
    return OrderRefused("too_late", problem, mend, order=order.order)
