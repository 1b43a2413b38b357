"""Orders of callers, between the threads that bring them, the tracked fleet and the database."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Final, TypeVar

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet import Fleet
from dispatcher_daemon.fleet.tracking import FleetTracker, TrackedVehicle, stop_of
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.service.intake.refusals import (
    MAX_KNOWN,
    conflict,
    not_answered,
    too_late,
    too_many,
    unknown,
)
from dispatcher_daemon.service.intake.service_area import ServiceArea
from dispatcher_daemon.service.intake.views import receipt_of, request_of, status_of, steps_of
from slipstream.messages import (
    OrderHistory,
    OrderReceipt,
    OrderRefusal,
    OrderRequest,
    OrderState,
    OrderStatus,
)
from slipstream.orders import ORDER_STATES, FleetRecords, OrderChange, OrderRecord, OrderRefused
from slipstream.roads import RoadNetwork
from storage import Database, OrderKnownError, Reader

T = TypeVar("T")

MAX_AT_ONCE: Final = 1000
"""Orders of one submission."""


class OrdersRefused(Exception):
    """Nothing of a submission was taken, for these reasons."""

    def __init__(self, refusals: Sequence[OrderRefusal]) -> None:
        self.refusals = tuple(refusals)
        first = self.refusals[0]
        super().__init__(
            f"{len(self.refusals)} orders refused, first {first.order}: {first.problem}"
        )


class OrderIntake:
    """Takes orders in; safe for threads. Each call returns when what it did is durable.

    Every method raises `StorageError` if the database cannot be used; then nothing has happened.

    Args:
        store: to write to, and to look up what the fleet's tracker has forgotten.
        announce: told of each change that is stored; it does not wait.
        taken: told of orders that are new; likewise.
    """

    def __init__(
        self,
        watch: FleetWatch,
        store: Database,
        archive: Reader,
        network: RoadNetwork,
        clock: Callable[[], int] = time.time_ns,
        announce: Callable[[OrderChange], None] = lambda change: None,
        taken: Callable[[Sequence[str]], None] = lambda names: None,
    ) -> None:
        self._announce, self._taken = announce, taken
        self._watch, self._store, self._archive = watch, store, archive
        self._network, self._clock = network, clock
        self._area: tuple[Fleet | None, ServiceArea] | None = None

    def submit(self, requests: Sequence[OrderRequest]) -> list[tuple[OrderReceipt, bool]]:
        """Take orders, all or none.

        Returns:
            The receipt of each, and whether it is new. One that is known with the same content is
            not, and its receipt is that of the first time, with its state now.

        Raises:
            OrdersRefused: some cannot be taken.
        """
        try:
            try:
                found = self._submit(requests, {})
            except (OrderKnownError, OrdersRefused) as error:
                # Some may have ended so long ago that the tracker has forgotten them. Looked up
                # only here: mostly all are new, and their caller waits.
                names = {request.id for request in requests}
                past = {order.order: order for order in self._store.find_orders(names)}
                if not past and isinstance(error, OrdersRefused):
                    raise
                found = self._submit(requests, past)
        except OrdersRefused as refused:
            for refusal in refused.refusals:
                metrics.ORDERS_REFUSED.labels(refusal.kind).inc()
            raise
        new = [receipt.order for receipt, is_new in found if is_new]
        if new:
            metrics.ORDERS_TAKEN.inc(len(new))
            self._taken(new)
        return found

    def _submit(
        self, requests: Sequence[OrderRequest], past: Mapping[str, OrderRecord]
    ) -> list[tuple[OrderReceipt, bool]]:
        ids = {request.id for request in requests}
        known = self._watch.read(lambda tracker: ids.intersection(tracker.book.orders))
        now_ns, area = self._clock(), self._service_area()
        nodes: dict[str, str] = {}
        refusals: dict[int, OrderRefusal] = {}
        for number, request in enumerate(requests):
            if request.id in known or request.id in past:
                continue
            try:
                nodes[request.id] = area.check(request, now_ns)
            except OrderRefused as refused:
                refusals[number] = refused.refusal

        def take(tracker: FleetTracker) -> list[tuple[OrderReceipt, bool]]:
            taken: list[tuple[OrderReceipt, bool]] = []
            for number, request in enumerate(requests):
                if number in refusals:
                    continue
                order = tracker.book.orders.get(request.id, past.get(request.id))
                if order is not None and request_of(order) != request:
                    refusals[number] = conflict(order)
                    continue
                if order is None:
                    node = nodes.get(request.id) or area.check(request, now_ns)
                    if len(tracker.book.orders) >= MAX_KNOWN:
                        raise OrdersRefused([too_many(request.id)])
                    tracker.book.submit(request, node, now_ns)
                found = order or tracker.book.orders[request.id]
                taken.append((receipt_of(found, self._network), order is None))
            if refusals:
                raise OrdersRefused([refusals[number] for number in sorted(refusals)])
            return taken

        return self._edit(take, self._store.add_orders)

    def show(self, name: str) -> OrderHistory:
        """An order with its life. Raises OrderRefused: it is not known."""
        found = self._watch.read(
            lambda tracker: (
                None
                if name not in tracker.book.orders
                else (
                    status_of(tracker.book.orders[name], tracker, self._clock()),
                    tracker.book.steps(name),
                )
            )
        )
        if found is None:
            past = self._store.find_orders({name})
            if not past:
                raise unknown(name)
            found = status_of(past[0], None, self._clock()), ()
        status, pending = found
        history = steps_of(self._archive.order_changes(name), pending)
        return OrderHistory(**dict(status), history=tuple(history))

    def page(
        self,
        states: Collection[OrderState] = ORDER_STATES,
        after: str | None = None,
        limit: int = 100,
    ) -> list[OrderStatus]:
        """Orders in some states by id: those that have not ended, or ended within a day."""

        def read(tracker: FleetTracker) -> list[OrderStatus]:
            book = tracker.book.orders
            names = (
                n for n, o in book.items() if o.state in states and (after is None or n > after)
            )
            return [
                status_of(book[name], tracker, self._clock())
                for name in heapq.nsmallest(limit, names)
            ]

        return self._watch.read(read)

    def cancel(self, name: str, reason: str | None = None) -> OrderStatus:
        """Cancel an order that no vehicle has left with; one that was cancelled stays so.

        Raises:
            OrderRefused: it is not known, is the file's, has ended, or is under way.
        """

        def cancel(tracker: FleetTracker, order: OrderRecord) -> None:
            if order.request is None:
                problem, mend = "it is a stop of the fleet's file", "take it out of the file"
                raise OrderRefused("conflict", problem, mend, order=name)
            if order.state in ("open", "planned"):
                tracker.book.cancel(name, self._clock(), reason)
            elif order.state != "cancelled":
                raise too_late(order)

        return self._change(name, cancel)

    def pin(self, name: str, vehicle: str | None = None, reason: str | None = None) -> OrderStatus:
        """Keep an order for one vehicle in all plans to come.

        Args:
            vehicle: None: that whose plan has it.

        Raises:
            OrderRefused: it is not known or has ended, no vehicle has it, the one that is named
                could not serve it, or another one has accepted it, has not answered a plan with
                it yet, or has it as its first stop.
        """
        area = self._service_area()

        def pin(tracker: FleetTracker, order: OrderRecord) -> None:
            _check_not_ended(order)
            holder = order.vehicle
            wanted = vehicle or holder
            if wanted is None:
                problem, mend = "no vehicle has it yet", "name the vehicle"
                raise OrderRefused("invalid", problem, mend, order=name, key="vehicle")
            if holder not in (None, wanted):
                assert holder is not None
                tracked = tracker.vehicles.get(holder)
                if order.state == "under_way" or (tracked is not None and tracked.accepted):
                    raise too_late(order)
                if tracked is not None and tracked.has_telemetry and _is_offered(tracked, name):
                    # It may have accepted it already: its answer is on its way.
                    raise not_answered(order)
            loaded = _loaded_on(tracker, order)
            if loaded not in (None, wanted):
                problem, mend = f"it is the first stop of {loaded}", "change the fleet's file"
                raise OrderRefused("conflict", problem, mend, order=name, key="vehicle")
            stop = stop_of(order, self._watch.fleet, self._clock())
            area.check_vehicles(stop, wanted)
            tracker.book.pin(name, wanted, self._clock(), reason)

        return self._change(name, pin)

    def release(self, name: str, reason: str | None = None) -> OrderStatus:
        """Let any vehicle serve an order that is pinned; one that is not stays so.

        Raises:
            OrderRefused: it is not known, or has ended.
        """

        def release(tracker: FleetTracker, order: OrderRecord) -> None:
            _check_not_ended(order)
            tracker.book.pin(name, None, self._clock(), reason)

        return self._change(name, release)

    def settle(self, name: str, *, served: bool, reason: str | None = None) -> OrderStatus:
        """Somebody who knows says whether an order was served; if not it is open again.

        Raises:
            OrderRefused: it is not known, or has ended.
        """

        def settle(tracker: FleetTracker, order: OrderRecord) -> None:
            _check_not_ended(order)
            if served or order.state != "open":
                tracker.settle(name, self._clock(), served=served, reason=reason)

        return self._change(name, settle)

    def _change(
        self, name: str, change: Callable[[FleetTracker, OrderRecord], None]
    ) -> OrderStatus:
        """Change one order, and tell how it then stands. Raises OrderRefused."""
        past = self._past(name)

        def edit(tracker: FleetTracker) -> OrderStatus:
            order = tracker.book.orders.get(name, past)
            if order is None:
                raise unknown(name)
            change(tracker, order)
            return status_of(tracker.book.orders.get(name, order), tracker, self._clock())

        return self._edit(edit)

    def _edit(
        self,
        edit: Callable[[FleetTracker], T],
        store: Callable[[FleetRecords], None] | None = None,
    ) -> T:
        began = time.monotonic()
        store = store or self._store.save_fleet

        def save(records: FleetRecords) -> None:
            store(records)
            # Under the fleet's lock, so that nobody is told of a later change before.
            for change in records.changes:
                self._announce(change)

        found = self._watch.edit(edit, save)
        metrics.ORDER_SECONDS.observe(time.monotonic() - began)
        return found

    def _past(self, name: str) -> OrderRecord | None:
        """One that the tracker has forgotten. The database is not asked under the fleet's lock."""
        if self._watch.read(lambda tracker: name in tracker.book.orders):
            return None
        return next(iter(self._store.find_orders({name})), None)

    def _service_area(self) -> ServiceArea:
        """That of the fleet's file as the last cycle has read it."""
        fleet, known = self._watch.fleet, self._area
        if known is None or known[0] is not fleet:
            area = ServiceArea(self._network, fleet)
            if known is not None:
                area.take_over(known[1])
            self._area = known = fleet, area
        return known[1]


def _check_not_ended(order: OrderRecord) -> None:
    if order.ended:
        raise too_late(order)


def _loaded_on(tracker: FleetTracker, order: OrderRecord) -> str | None:
    """The vehicle whose first stop an order of the file is; None: it is nobody's."""
    if order.request is not None:
        return None
    vehicles = (v for v in tracker.vehicles.values() if v.listed)
    return next((v.id for v in vehicles if v.definition.first_stop == order.order), None)


def _is_offered(vehicle: TrackedVehicle, name: str) -> bool:
    plan = None if vehicle.offered is None else vehicle.offered.plan
    return plan is not None and any(stop.stop == name for stop in plan.service_stops)
