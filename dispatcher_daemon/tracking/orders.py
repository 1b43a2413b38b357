"""The life of orders: each change with its time and reason."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

from dispatcher_daemon.fleet import Stop
from slipstream.messages import OrderState, PlannedStop, VehiclePlan, Visit
from slipstream.orders import OrderChange, OrderRecord

REMEMBERED_NS: Final = 86_400 * 10**9
"""How long an ended order is known after the fleet's file has dropped it."""


class OrderBook:
    """All orders. Each is held by one vehicle at most, and ends once.

    A holder is the vehicle whose plan has the order, or that has left with it.
    """

    def __init__(self, orders: Iterable[OrderRecord] = ()) -> None:
        self._orders: dict[str, OrderRecord] = {}
        self._held: dict[str, dict[str, None]] = {}
        self._changed: dict[str, None] = {}
        for order in orders:
            self._quietly(order)
        self._changes: list[OrderChange] = []
        self._changed.clear()

    @property
    def orders(self) -> Mapping[str, OrderRecord]:
        """By id."""
        return MappingProxyType(self._orders)

    def held_by(self, vehicle: str) -> tuple[str, ...]:
        """Ids of the orders that a vehicle holds and has not ended."""
        return tuple(self._held.get(vehicle, ()))

    def pending(self) -> tuple[tuple[OrderRecord, ...], tuple[OrderChange, ...]]:
        """Orders that are new or changed since `stored` was called last, and all their changes."""
        orders = tuple(self._orders[name] for name in self._changed if name in self._orders)
        return orders, tuple(self._changes)

    def mark_all(self) -> None:
        """All orders are pending."""
        self._changed = dict.fromkeys(self._orders)

    def stored(self) -> None:
        """What was pending is in the database."""
        self._changed, self._changes = {}, []

    def list_stops(self, stops: Collection[Stop], now_ns: int) -> None:
        """Take over the stops of the fleet's file.

        A new one is an open order, and so is one that was cancelled before. One that is gone is
        cancelled, unless its vehicle has left with it: what is loaded is delivered. One that has
        been served or has failed stays so, however long it is listed.
        """
        listed = set()
        for stop in stops:
            listed.add(stop.id)
            known = self._orders.get(stop.id)
            if known is None:
                self._set(_opened(stop, now_ns, "new in the fleet's file"))
            elif known.state == "cancelled":
                self._set(_opened(stop, now_ns, "in the fleet's file again"))
            elif not known.listed:
                self._quietly(replace(known, listed=True))
        for order in list(self._orders.values()):
            if order.order in listed:
                continue
            if order.listed:
                order = replace(order, listed=False)
                self._quietly(order)
            if order.state in ("open", "planned"):
                self._move(order, "cancelled", now_ns, "no longer in the fleet's file")
            elif order.ended and order.since_ns < now_ns - REMEMBERED_NS:
                del self._orders[order.order]

    def plan(
        self, plan: VehiclePlan, stops: Mapping[str, Stop], reference_ns: int, now_ns: int
    ) -> None:
        """A published plan has its stops.

        Args:
            plan: from a depot.
            stops: of the fleet, by id.
            reference_ns: UTC that the fleet's times count from.
            now_ns: UTC.
        """
        for visit in plan.service_stops:
            stop = stops[visit.stop]
            self._move(
                replace(self._orders[stop.id], **_details(stop, reference_ns)),
                "planned",
                now_ns,
                f"in the plan of cycle {plan.cycle} for {plan.vehicle}",
                vehicle=plan.vehicle,
                cycle=plan.cycle,
            )

    def release(self, vehicle: str, now_ns: int, reason: str, *, loaded: bool = False) -> None:
        """Orders that a vehicle holds are open again: those it has not left with, or all."""
        for name in self.held_by(vehicle):
            order = self._orders[name]
            if loaded or order.state == "planned":
                self._open(order, now_ns, reason)

    def keep_only(self, plan: VehiclePlan, now_ns: int) -> None:
        """What a vehicle held by an earlier plan, and this one leaves out, is open again."""
        kept = {stop.stop for stop in plan.stops}
        for name in self.held_by(plan.vehicle):
            if name not in kept:
                self._open(
                    self._orders[name], now_ns, f"left out of the plan of cycle {plan.cycle}"
                )

    def assign(self, order: str, vehicle: str, cycle: int, now_ns: int) -> None:
        """A vehicle follows a plan with an order that had been taken back."""
        reason = f"{vehicle} follows the plan of cycle {cycle}"
        self._move(self._orders[order], "planned", now_ns, reason, vehicle=vehicle, cycle=cycle)

    def leave(self, vehicle: str, stops: Iterable[PlannedStop], now_ns: int) -> None:
        """A vehicle has left with the orders of its plan, those cancelled too late among them."""
        for visit in stops:
            order = self._orders.get(visit.stop)
            if order is None or order.vehicle != vehicle:
                continue
            if order.state in ("planned", "cancelled"):
                late = " before it was cancelled" if order.state == "cancelled" else ""
                self._move(order, "under_way", now_ns, f"{vehicle} has left with it{late}")

    def visited(self, vehicle: str, visit: Visit, now_ns: int) -> None:
        """A vehicle reports a visit.

        Only its holder can fail an order. Who says that it has served one has, whoever was to do
        it, unless it was opened after that visit.
        """
        order = self._orders.get(visit.stop)
        if order is None or order.state in ("served", "failed"):
            return
        own = order.vehicle == vehicle
        if visit.status == "served":
            before = visit.ended_ns is not None and visit.ended_ns < order.since_ns
            if own or not before:
                self._move(order, "served", now_ns, f"served by {vehicle}", vehicle=vehicle)
        elif own and visit.status == "failed":
            self._move(order, "failed", now_ns, f"{vehicle}: {visit.reason}")
        elif own and order.state == "planned":
            self._move(order, "under_way", now_ns, f"{vehicle} is there")

    def assume_served(self, vehicle: str, order: str, now_ns: int, reason: str) -> None:
        """The holder sends no visits, and must have served it by what else it sends."""
        if order in self.held_by(vehicle):
            self._move(self._orders[order], "served", now_ns, reason)

    def _open(self, order: OrderRecord, now_ns: int, reason: str) -> None:
        self._move(order, "open", now_ns, reason, vehicle=None, cycle=None)
        if not order.listed:
            # Nobody asks for it any more.
            gone = "no longer in the fleet's file"
            self._move(self._orders[order.order], "cancelled", now_ns, gone)

    def counts(self) -> dict[OrderState, int]:
        """Number of orders by state."""
        found: dict[OrderState, int] = {}
        for order in self._orders.values():
            found[order.state] = found.get(order.state, 0) + 1
        return found

    def _move(
        self, order: OrderRecord, state: OrderState, now_ns: int, reason: str, **changes: Any
    ) -> None:
        moved = replace(order, state=state, since_ns=now_ns, reason=reason, **changes)
        if (order.state, order.vehicle) == (moved.state, moved.vehicle):
            # Planned anew for the same vehicle: no step in its life.
            self._quietly(replace(moved, since_ns=order.since_ns, reason=order.reason))
        else:
            self._set(moved)

    def _set(self, order: OrderRecord) -> None:
        self._quietly(order)
        self._changes.append(
            OrderChange(
                order.order,
                order.since_ns,
                order.state,
                order.reason,
                order.vehicle,
                order.cycle,
            )
        )

    def _quietly(self, order: OrderRecord) -> None:
        before = self._orders.get(order.order)
        if before is not None and before.vehicle is not None:
            self._held.get(before.vehicle, {}).pop(order.order, None)
        if order.vehicle is not None and order.state in ("planned", "under_way"):
            self._held.setdefault(order.vehicle, {})[order.order] = None
        self._orders[order.order] = order
        self._changed[order.order] = None


def _opened(stop: Stop, now_ns: int, reason: str) -> OrderRecord:
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


def _details(stop: Stop, reference_ns: int) -> dict[str, Any]:
    def at(seconds: float) -> int:
        return reference_ns + round(1e9 * seconds)

    return {
        "node": stop.node,
        "service_s": stop.service_s,
        "demand": stop.demand,
        "earliest_ns": at(stop.earliest_s),
        "latest_ns": None if stop.latest_s is None else at(stop.latest_s),
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
            earliest_s=min(earliest_s, 86_400.0),
            latest_s=None
            if order.latest_ns is None
            else min(max(after(order.latest_ns), earliest_s), 86_400.0),
        )
