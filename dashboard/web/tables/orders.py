"""Orders as rows, judged by the clock and by what is heard of their vehicles; pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from dashboard.view.model import VehicleView
from dashboard.web.tables.rows import Row, Scene, ms
from slipstream.messages import VehiclePlan
from slipstream.orders import OrderRecord

OVERDUE_NS: Final = 60 * 10**9
"""An order is late by its arrival so long after it: a vehicle's word takes some time."""


@dataclass(frozen=True)
class Serving:
    """What of a vehicle says whether its orders will be served in time.

    Attributes:
        plans: its latest, and the one that it follows.
        at: the stop that it reports to stand at; None: at none.
        delay_s: that it reports; 0 where it reports none.
    """

    plans: tuple[VehiclePlan, ...]
    silent_ns: int | None = None
    reported: bool = False
    at: str | None = None
    delay_s: float = 0.0

    @classmethod
    def of(cls, van: VehicleView, plan: VehiclePlan) -> Serving:
        """That of a vehicle."""
        done = van.progress
        at = None if done.at is None else van.plan.stops[done.at].stop
        return cls(
            (plan, van.plan), van.silent_ns, done.reported, at, max(0.0, done.delay_s or 0.0)
        )

    def eta_ns(self, order: str) -> int | None:
        """UTC of its arrival at an order; None: its plan has no such stop."""
        stops = (stop for plan in self.plans for stop in plan.stops if stop.stop == order)
        return next((stop.arrival_ns + round(self.delay_s * 1e9) for stop in stops), None)


def servings(vans: Sequence[VehicleView], plans: Mapping[str, VehiclePlan]) -> dict[str, Serving]:
    """What says whether orders will be served in time, by vehicle."""
    return {van.vehicle: Serving.of(van, plans.get(van.vehicle, van.plan)) for van in vans}


def order_row(order: OrderRecord, serving: Serving | None, scene: Scene, now_ns: int) -> Row:
    """One order, judged by the clock: what is over is never taken for on its way."""
    place = scene.places.at_node(order.node)
    carried = None if order.ended else serving
    eta_ns = None if carried is None else carried.eta_ns(order.order)
    overdue_ns = _overdue_ns(order, carried, eta_ns, now_ns)
    missed = overdue_ns is not None and overdue_ns == order.latest_ns
    late_s = None
    if order.latest_ns is not None:
        ends_ns = order.since_ns if order.state == "served" else eta_ns
        if missed:
            ends_ns = max(now_ns, eta_ns or 0)
        if ends_ns is not None and not (order.ended and order.state != "served"):
            late_s = max(0, round((ends_ns - order.latest_ns) / 1e9))
            # A clock that runs changes a row once a minute.
            late_s -= late_s % 60 if missed else 0
    silent_ns = None if carried is None else carried.silent_ns
    level = {"failed": "bad", "cancelled": "idle"}.get(order.state, "ok")
    unknown = carried is None or not (carried.reported or carried.silent_ns is not None)
    if unknown and order.vehicle is not None and not order.ended:
        level = "idle"
    waits = order.state == "open" and order.cycle is None and order.reason
    if late_s or overdue_ns is not None or (waits and order.latest_ns is not None):
        level = "warn" if level in ("ok", "idle") and order.state != "cancelled" else level
    if missed or silent_ns is not None:
        level = "bad"
    return {
        "state": order.state,
        "level": level,
        "node": order.node,
        "x": None if place is None else round(place[0], 1),
        "y": None if place is None else round(place[1], 1),
        "vehicle": order.vehicle,
        "eta": ms(eta_ns),
        "earliest": ms(order.earliest_ns),
        "latest": ms(order.latest_ns),
        "late_s": late_s,
        "late_since": ms(overdue_ns),
        "silent_since": ms(silent_ns),
        "pinned": order.pinned,
        "source": order.source,
        "why": order.reason or None,
        "since": ms(order.since_ns),
    }


def _overdue_ns(
    order: OrderRecord, serving: Serving | None, eta_ns: int | None, now_ns: int
) -> int | None:
    """UTC since when an order is late: its window has closed, or it was to be reached before now.

    None: it is not, or its vehicle stands there.
    """
    if order.ended or (serving is not None and serving.at == order.order):
        return None
    if order.latest_ns is not None and order.latest_ns < now_ns:
        return order.latest_ns
    return eta_ns if eta_ns is not None and eta_ns + OVERDUE_NS < now_ns else None


def changes_ns(order: OrderRecord, row: Row, serving: Serving | None, now_ns: int) -> int | None:
    """UTC at which the clock alone changes an order's row; None: it never does."""
    if order.ended:
        return None
    if row["late_s"] and row["late_since"] is not None:
        return now_ns + 60 * 10**9
    eta_ns = None if serving is None else serving.eta_ns(order.order)
    ends = [order.latest_ns, None if eta_ns is None else eta_ns + OVERDUE_NS]
    return min((end for end in ends if end is not None and end >= now_ns), default=None)
