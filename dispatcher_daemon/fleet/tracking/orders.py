"""The life of orders: each change with its time and reason."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

from dispatcher_daemon.fleet.stops import Stop
from dispatcher_daemon.fleet.tracking.order_stops import details, opened
from slipstream.messages import OrderRequest, OrderState, PlannedStop, VehiclePlan, Visit
from slipstream.orders import FleetRecords, OrderChange, OrderRecord, utc, with_reason

CANCELLED: Final = "cancelled by its caller"
REMEMBERED_NS: Final = 86_400 * 10**9
"""How long an ended order is known after nobody asks for it any more."""

OrderMark = tuple[Mapping[str, OrderRecord], int]
"""(orders at a moment by id, number of changes that were pending)."""


class OrderBook:
    """All orders. Each is held by one vehicle at most, and ends once.

    A holder is the vehicle whose plan has the order, or that has left with it.
    """

    def __init__(self, orders: Iterable[OrderRecord] = ()) -> None:
        self._orders: dict[str, OrderRecord] = {}
        self._held: dict[str, dict[str, None]] = {}
        self._disputed: set[str] = set()
        self._changed: dict[str, None] = {}
        self._before: dict[str, OrderRecord | None] | None = None
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

    def mark(self, names: Iterable[str]) -> OrderMark:
        """Some orders as they are now, for `undo`."""
        known = {name: self._orders[name] for name in names if name in self._orders}
        return known, len(self._changes)

    def undo(self, mark: OrderMark) -> None:
        """Where an order of a mark has its state and vehicle of then again, nothing has happened to
        it: a cycle that cannot be stored leaves no steps, or they would pile up until one is.
        """
        before, number = mark
        back = {n: was for n, was in before.items() if _holding(self._orders[n]) == _holding(was)}
        for order in back.values():
            self._quietly(order)
        self._changes[number:] = [one for one in self._changes[number:] if one.order not in back]

    def steps(self, order: str) -> tuple[OrderChange, ...]:
        """Changes of one order since `stored` was called last."""
        return tuple(change for change in self._changes if change.order == order)

    @contextmanager
    def stored_at_once(self, save: Callable[[FleetRecords], None]) -> Iterator[None]:
        """What happens to orders inside is stored before it ends, with what else is pending of
        these orders. If that fails, or anything inside, nothing has happened.
        """
        pending, changes = self._changed, self._changes
        self._changed, self._changes, self._before = {}, list(changes), {}
        try:
            yield
            touched = self._changed
            if touched:
                own = tuple(change for change in self._changes if change.order in touched)
                save(FleetRecords(tuple(self._orders[name] for name in touched), own))
            self._changed = {name: None for name in pending if name not in touched}
            self._changes = [change for change in changes if change.order not in touched]
        except BaseException:
            before, self._before = self._before, None
            for name, order in before.items():
                self._unhold(name)
                if order is None:
                    del self._orders[name]
                else:
                    self._quietly(order)
            self._changed, self._changes = pending, changes
            raise
        finally:
            self._before = None

    def submit(self, request: OrderRequest, node: str, now_ns: int) -> None:
        """A caller asks for an order that is not known yet, at a junction."""
        self._set(
            OrderRecord(
                order=request.id,
                node=node,
                service_s=request.service_s,
                demand=request.demand,
                earliest_ns=request.earliest,
                latest_ns=request.latest,
                state="open",
                since_ns=now_ns,
                reason="submitted",
                request=request.model_dump(mode="json"),
                received_ns=now_ns,
                pinned=request.vehicle,
            )
        )

    def cancel(self, order: str, now_ns: int, reason: str | None = None) -> None:
        """A caller does not want an order any more that no vehicle has left with."""
        text = f"cancelled: {reason}" if reason else CANCELLED
        self._move(self._orders[order], "cancelled", now_ns, text)

    def pin(self, order: str, vehicle: str | None, now_ns: int, reason: str | None = None) -> None:
        """Only this vehicle may serve an order from now on; None: any."""
        known = self._orders[order]
        if known.pinned != vehicle:
            done = f"released from {known.pinned}" if vehicle is None else f"pinned to {vehicle}"
            told = with_reason(done, reason)
            self._set(replace(known, pinned=vehicle, since_ns=now_ns, reason=told))

    def expire(self, now_ns: int) -> None:
        """Callers' open orders whose windows have closed have failed."""
        for order in list(self._orders.values()):
            if order.request is None or order.state != "open" or order.latest_ns is None:
                continue
            if order.latest_ns < now_ns:
                reason = f"its window closed at {utc(order.latest_ns)}, and nobody had served it"
                self._move(order, "failed", now_ns, reason)

    def list_stops(self, stops: Collection[Stop], now_ns: int) -> None:
        """Take over the stops of the fleet's file. An order that a caller asks for stays as it is
        until it has ended; then the file's stop of its id takes its place.

        A new one is an open order, and so is one that was cancelled before. One that is gone is
        cancelled, unless its vehicle has left with it: what is loaded is delivered. One that has
        been served or has failed stays so, however long it is listed.
        """
        listed = set()
        for stop in stops:
            listed.add(stop.id)
            known = self._orders.get(stop.id)
            if known is None:
                self._set(opened(stop, now_ns, "new in the fleet's file"))
            elif known.request is not None:
                if known.ended:
                    self._set(opened(stop, now_ns, "in the fleet's file, after a caller's order"))
            elif known.state == "cancelled":
                again = opened(stop, now_ns, "in the fleet's file again")
                self._set(replace(again, pinned=known.pinned))
            elif not known.listed:
                self._quietly(replace(known, listed=True))
        for order in list(self._orders.values()):
            if order.order in listed:
                continue
            if order.request is None:
                if order.listed:
                    order = replace(order, listed=False)
                    self._quietly(order)
                if order.state in ("open", "planned"):
                    self._move(order, "cancelled", now_ns, "no longer in the fleet's file")
                    continue
            if order.ended and order.since_ns < now_ns - REMEMBERED_NS:
                self._disputed.discard(order.order)
                del self._orders[order.order]

    def plan(
        self,
        plan: VehiclePlan,
        stops: Mapping[str, Stop],
        reference_ns: int,
        now_ns: int,
        before: VehiclePlan | None = None,
    ) -> None:
        """A published plan has its stops.

        Args:
            before: what its vehicle has accepted; only stops beside these are planned.
        """
        known = () if before is None else {visit.stop for visit in before.stops}
        for visit in plan.service_stops:
            if visit.stop in known:
                continue
            stop, order = stops[visit.stop], self._orders[visit.stop]
            if order.request is None:
                order = replace(order, **details(stop, reference_ns))
            self._move(
                order,
                "planned",
                now_ns,
                f"in the plan of cycle {plan.cycle} for {plan.vehicle}",
                vehicle=plan.vehicle,
                cycle=plan.cycle,
            )

    def dispute(self, order: str, *, lasts: bool) -> None:
        """Whether the holder of an order says that it has served it, and is not believed: once it
        has left with it nobody else gets it before somebody has decided.
        """
        (self._disputed.add if lasts else self._disputed.discard)(order)

    def settle(self, order: str, now_ns: int, *, served: bool, reason: str | None) -> None:
        """Somebody who knows says whether an order was served; if not it is open again."""
        if served:
            told = with_reason("an operator says so", reason)
            self._move(self._orders[order], "served", now_ns, told)
        else:
            told = with_reason("an operator says that it was not served", reason)
            self._open(self._orders[order], now_ns, told)

    def _may_open(self, order: OrderRecord) -> bool:
        return order.state != "under_way" or order.order not in self._disputed

    def release(self, vehicle: str, now_ns: int, reason: str, *, loaded: bool = False) -> None:
        """Orders that a vehicle holds are open again: those it has not left with, or all."""
        for name in self.held_by(vehicle):
            order = self._orders[name]
            if order.state == "planned" or (loaded and self._may_open(order)):
                self._open(order, now_ns, reason)

    def keep_only(self, plan: VehiclePlan, now_ns: int) -> None:
        """What a vehicle held by an earlier plan, and this one leaves out, is open again."""
        kept = {stop.stop for stop in plan.stops}
        for name in self.held_by(plan.vehicle):
            if name not in kept and self._may_open(self._orders[name]):
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
        """A visit that counts; see `dispatcher_daemon.fleet.tracking.claims`."""
        order = self._orders[visit.stop]
        if visit.status == "served":
            self._move(order, "served", now_ns, f"served by {vehicle}", vehicle=vehicle)
        elif visit.status == "failed":
            self._move(order, "failed", now_ns, f"{vehicle}: {visit.reason}")
        elif order.state == "planned":
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
            if order.request is not None:
                gone = CANCELLED
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
        self._disputed.discard(order.order)
        if moved.ended and moved.request is not None:
            moved = replace(moved, listed=False)
        if _holding(order) == _holding(moved):
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
        if self._before is not None:
            self._before.setdefault(order.order, self._orders.get(order.order))
        self._unhold(order.order)
        if order.vehicle is not None and order.state in ("planned", "under_way"):
            self._held.setdefault(order.vehicle, {})[order.order] = None
        self._orders[order.order] = order
        self._changed[order.order] = None

    def _unhold(self, name: str) -> None:
        order = self._orders.get(name)
        if order is not None and order.vehicle is not None:
            self._held.get(order.vehicle, {}).pop(name, None)


def _holding(order: OrderRecord) -> tuple[OrderState, str | None]:
    return order.state, order.vehicle
