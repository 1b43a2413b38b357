"""What vehicles say of orders, and whether holder, plan and place bear it out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

from dispatcher_daemon.fleet.tracking.committing import legs_of
from dispatcher_daemon.fleet.tracking.orders import OrderBook
from dispatcher_daemon.fleet.tracking.sightings import LEEWAY_NS, Presence
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle
from slipstream.messages import Visit
from slipstream.orders import OrderRecord, utc
from slipstream.roads import RoadNetwork

Verdict = Literal["true", "past", "open"]
"""Of what a vehicle says: it counts; it is of an order that has ended, or of another one that had
this id before; nothing counts of it yet."""
_UNTOLD: Final = "arrived"


@dataclass(frozen=True)
class Claim:
    """A visit that a vehicle tells, and that does not count."""

    vehicle: str
    visit: Visit
    since_ns: int
    reason: str

    @property
    def text(self) -> str:
        """In words."""
        ended = "" if self.visit.ended_ns is None else f" at {utc(self.visit.ended_ns)}"
        said = "served it" if self.visit.status == "served" else "failed to serve it"
        return f"{self.vehicle} says that it has {said}{ended}: {self.reason}"


class Claims:
    """Settles what vehicles say: their orders end where the vehicle holds them by a plan and was at
    their place. What does not count stays, and is looked at again with each report of its vehicle.
    """

    def __init__(self, book: OrderBook, network: RoadNetwork) -> None:
        self._book, self._network = book, network
        self._open: dict[str, dict[str, Claim]] = {}

    def disputed(self) -> Iterator[Claim]:
        """What vehicles say of ends of orders, and what does not count."""
        for claims in self._open.values():
            for claim in claims.values():
                order = self._book.orders.get(claim.visit.stop)
                over = order is None or order.state in ("served", "failed")
                if claim.visit.status != _UNTOLD and not over:
                    yield claim

    def of_order(self, order: str) -> Claim | None:
        """What is said of one order and does not count; None: nothing is."""
        return next((claim for claim in self.disputed() if claim.visit.stop == order), None)

    def forget(self, order: str) -> None:
        """Somebody has decided about an order: what was said of it before is past."""
        for claims in self._open.values():
            claims.pop(order, None)

    def tell(self, vehicle: TrackedVehicle, visits: tuple[Visit, ...], now_ns: int) -> None:
        """A vehicle tells visits; each counts, or stays."""
        claims = self._open.setdefault(vehicle.id, {})
        for visit in visits:
            known = claims.get(visit.stop)
            if known is None or known.visit != visit:
                since_ns = now_ns if known is None else known.since_ns
                claims[visit.stop] = Claim(vehicle.id, visit, since_ns, "")
        self.settle(vehicle, now_ns)

    def settle(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        """Look again at what a vehicle has told."""
        claims = self._open.get(vehicle.id)
        if not claims:
            return
        for name, claim in list(claims.items()):
            verdict, reason = self._judge(vehicle, claim.visit)
            if verdict == "open":
                claims[name] = replace(claim, reason=reason)
            else:
                del claims[name]
            if name in self._book.held_by(vehicle.id):
                lasts = verdict == "open" and claim.visit.status == "served"
                self._book.dispute(name, lasts=lasts)
            if verdict == "true":
                self._book.visited(vehicle.id, claim.visit, now_ns)

    def assume(self, vehicle: TrackedVehicle, order: str, now_ns: int, reason: str) -> None:
        """A vehicle that sends no visits has done with an order, by its plan; it is served if the
        vehicle can have been at its place.
        """
        given_ns = vehicle.given.get(order)
        if given_ns is None or order not in self._book.held_by(vehicle.id):
            return
        known = self._book.orders[order]
        presence = self._presence(vehicle, known, given_ns, given_ns, now_ns)
        if presence in ("there", "may_have_been") or self._has_passed(vehicle, order):
            self._book.assume_served(vehicle.id, order, now_ns, reason)

    def _judge(self, vehicle: TrackedVehicle, visit: Visit) -> tuple[Verdict, str]:
        """Whether a visit counts, and why not."""
        order = self._book.orders.get(visit.stop)
        if order is None or order.state in ("served", "failed"):
            return "past", ""
        given_ns = vehicle.given.get(order.order)
        ended_ns = visit.arrived_ns if visit.ended_ns is None else visit.ended_ns
        own = order.vehicle == vehicle.id
        if given_ns is not None and ended_ns < given_ns - LEEWAY_NS:
            return "past", ""
        if not own:
            before = ended_ns < order.since_ns and given_ns is None
            if visit.status == "arrived" or before:
                return "past", ""
            if (why := _not_its_own(vehicle, order, visit, given_ns)) is not None:
                return "open", why
        if visit.status == "failed":
            return "true", ""  # its holder may say so anywhere: it may have broken down
        presence = self._presence(vehicle, order, given_ns or 0, visit.arrived_ns, ended_ns)
        if presence == "there" or (own and self._has_passed(vehicle, order.order)):
            return "true", ""
        if presence == "may_have_been" and (own or order.vehicle is None):
            if visit.status == "served":
                place = self._network.junctions[order.node]
                times = given_ns or 0, visit.arrived_ns, ended_ns
                vehicle.sightings.note_visit(place, *times)
            return "true", ""
        if presence == "not_known":
            return "open", "its place at that time is not known"
        return "open", f"it was not near {order.node} then{_now_at(vehicle)}"

    def _presence(
        self,
        vehicle: TrackedVehicle,
        order: OrderRecord,
        since_ns: int,
        arrived_ns: int,
        ended_ns: int,
    ) -> Presence:
        place = self._network.junctions.get(order.node)
        times = since_ns, arrived_ns, ended_ns
        return vehicle.sightings.presence(order.order, place, *times)

    @staticmethod
    def _has_passed(vehicle: TrackedVehicle, order: str) -> bool:
        """Whether a vehicle is on its plan's way, on a leg behind the one to an order."""
        position, accepted = vehicle.position, vehicle.accepted
        if accepted is None or position is None or position.cycle != accepted.plan.cycle:
            return False
        plan = accepted.plan
        number = next((n for n, stop in enumerate(plan.stops) if stop.stop == order), None)
        if number is None or position.leg is None or not number <= position.leg < len(plan.stops):
            return False
        if not position.on_road:
            return False
        leg = legs_of(plan)[min(position.leg, len(plan.stops) - 2)]
        return any(planned.segment == position.segment for planned in leg)


def _not_its_own(
    vehicle: TrackedVehicle, order: OrderRecord, visit: Visit, given_ns: int | None
) -> str | None:
    """Why a vehicle that is not the holder of an order cannot have ended it; None: by a plan that
    it was sent before it can.
    """
    has = "nobody has it"
    if order.vehicle is not None and order.state == "planned":
        has = f"it is planned for {order.vehicle}"
    elif order.vehicle is not None and order.state == "under_way":
        has = f"{order.vehicle} has left with it"
    if order.pinned not in (None, vehicle.id):
        return f"it is pinned to {order.pinned}"
    if visit.status == "failed":
        return has
    if given_ns is None:
        return f"{has}, and no plan with it was sent to {vehicle.id}"
    return has if order.state == "under_way" else None


def _now_at(vehicle: TrackedVehicle) -> str:
    position = vehicle.position
    return "" if position is None else f"; it was last on {position.segment}"
