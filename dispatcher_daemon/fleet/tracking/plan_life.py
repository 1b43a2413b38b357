"""What becomes of plans: offered, acknowledged, followed, taken back, done; and of their orders."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from dispatcher_daemon.fleet.tracking.claims import Claims
from dispatcher_daemon.fleet.tracking.driven import DrivenBook
from dispatcher_daemon.fleet.tracking.orders import OrderBook
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle, ended
from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import PlanAcknowledgement, VehiclePlan
from slipstream.orders import PlanChange, PlanRecord, PlanStatus

ANSWER_NS: Final = 5 * 10**9
"""A vehicle that reports, and not by then that it follows its new plan, does not: the plan is taken
back. That of a silent one is when it lapses: it may be on its way, with an answer that was lost."""
LEAVE_NS: Final = 60 * 10**9
"""So long after its departure a plan is taken back whose vehicle says that it follows none."""
LEFT_OUT_CYCLES: Final = 3
"""Cycles in which a vehicle that refused a plan, or did not answer it, is not planned."""


class PlanLife:
    """Moves vehicles from plan to plan, and their orders with them.

    Args:
        may_have: whether an order is there for any vehicle at a moment, UTC ns.
    """

    def __init__(
        self, book: OrderBook, claims: Claims, may_have: Callable[[str, int], bool]
    ) -> None:
        self._book, self._claims, self._may_have = book, claims, may_have
        self._changed: dict[tuple[int, str], PlanRecord] = {}
        self._changes: list[PlanChange] = []
        self.driven = DrivenBook()

    @property
    def pending(self) -> tuple[PlanRecord, ...]:
        """Plans whose status has changed since `stored` was called last."""
        return tuple(self._changed.values())

    @property
    def changes(self) -> tuple[PlanChange, ...]:
        """Each of these changes, in their order, with the plans that went out."""
        return tuple(self._changes)

    def stored(self) -> None:
        """What was pending is in the database."""
        self._changed, self._changes = {}, []
        self.driven.stored()

    def note(self, record: PlanRecord) -> None:
        """The status of a plan has changed."""
        self._changed[record.plan.cycle, record.plan.vehicle] = record
        self._step(record)

    def _step(self, record: PlanRecord) -> None:
        plan = record.plan
        step = PlanChange(plan.cycle, plan.vehicle, record.since_ns, record.status, record.reason)
        self._changes.append(step)

    def offer(
        self, vehicle: TrackedVehicle, plan: VehiclePlan, now_ns: int, energy: PlanEnergy | None
    ) -> None:
        """A plan goes out to its vehicle."""
        if vehicle.offered is not None:
            reason = f"by the plan of cycle {plan.cycle}"
            self.note(ended(vehicle.offered, "superseded", now_ns, reason))
        for stop in plan.stops:
            vehicle.given.setdefault(stop.stop, vehicle.by_its_clock(now_ns))
        vehicle.offered = PlanRecord(plan, "published", now_ns, energy=energy)
        self._step(vehicle.offered)

    def retract(self, plans: Iterable[VehiclePlan]) -> None:
        """Plans that were on offer did not go out."""
        gone = {(plan.cycle, plan.vehicle) for plan in plans}
        self._changes = [one for one in self._changes if (one.cycle, one.vehicle) not in gone]

    def refused(self, vehicle: TrackedVehicle, answer: PlanAcknowledgement, now_ns: int) -> None:
        """A vehicle refuses a plan. What it has acknowledged it may give back until it leaves; a
        refused next version changes nothing.
        """
        offered, accepted = vehicle.offered, vehicle.accepted
        left_out_until = answer.cycle + 1 + LEFT_OUT_CYCLES
        if offered is not None and offered.plan.cycle == answer.cycle:
            if accepted is None:
                reason = f"{vehicle.id} refused its plan: {answer.reason}"
                self.drop(vehicle, offered, "refused", now_ns, reason)
                vehicle.left_out_until = left_out_until
            else:
                self.drop_offer(vehicle, "refused", now_ns, str(answer.reason))
        elif accepted is not None and accepted.plan.cycle == answer.cycle and not vehicle.left:
            reason = f"{vehicle.id} gave its plan back: {answer.reason}"
            self.drop(vehicle, accepted, "refused", now_ns, reason)
            vehicle.left_out_until = left_out_until

    def follows(
        self, vehicle: TrackedVehicle, cycle: int, now_ns: int, *, left: bool = False
    ) -> None:
        """A vehicle has acknowledged the plan of a cycle, or says that it follows it.

        A plan that was taken back counts again where the vehicle has left by it, or some of its
        orders are still to be had.
        """
        offered, withdrawn, accepted = vehicle.offered, vehicle.withdrawn, vehicle.accepted
        if offered is None or offered.plan.cycle != cycle:
            if withdrawn is None or withdrawn.plan.cycle != cycle:
                return
            if accepted is not None and accepted.plan.cycle > cycle:
                return
            stops = [stop.stop for stop in withdrawn.plan.service_stops]
            to_have = any(self._may_have(stop, now_ns) for stop in stops)
            if accepted is None and not left and not to_have:
                return
            if offered is not None:
                self.drop_offer(vehicle, "superseded", now_ns, "its vehicle follows another plan")
                if accepted is None:
                    self._book.release(vehicle.id, now_ns, f"{vehicle.id} follows another plan")
            vehicle.offered, vehicle.withdrawn = withdrawn, None
        self.driven.replace(vehicle, now_ns)
        for record in vehicle.accept(now_ns):
            self.note(record)
        assert vehicle.accepted is not None
        for stop in vehicle.accepted.plan.service_stops:
            if self._may_have(stop.stop, now_ns):
                self._book.assign(stop.stop, vehicle.id, cycle, now_ns)

    def drives(self, vehicle: TrackedVehicle, plan: VehiclePlan, leg: int, now_ns: int) -> None:
        """A vehicle is on a leg of its plan, or will drive it next."""
        assert vehicle.position is not None
        vehicle.leg = max(vehicle.leg, min(leg, len(plan.stops) - 2))
        left = plan.stops[: vehicle.leg + vehicle.position.on_road]
        breaks = [stop for stop in left if stop.kind == "break"]
        if breaks and vehicle.rested_ns < breaks[-1].arrival_ns:
            vehicle.rested_ns = now_ns
            own = vehicle.definition
            names = [own.break_id(number) for number in range(len(own.breaks))]
            last = breaks[-1].stop
            vehicle.rested_break = names.index(last) if last in names else None
        if vehicle.position.on_road or vehicle.leg > 0:
            self.leave(vehicle, now_ns)
        if not vehicle.reports_progress and vehicle.left:
            passed = vehicle.leg + 1 if vehicle.position.on_road else vehicle.leg
            for stop in plan.stops[:passed]:
                reason = f"{vehicle.id} has driven on"
                self._claims.assume(vehicle, stop.stop, now_ns, reason)

    def leave(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        """A vehicle has left its depot by the plan that it has acknowledged."""
        assert vehicle.accepted is not None
        vehicle.left = True
        self._book.leave(vehicle.id, vehicle.accepted.plan.service_stops, now_ns)

    def come_back(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        """End the tour of a vehicle that is free again."""
        accepted = vehicle.accepted
        if accepted is None or vehicle.free_since_ns is None:
            return
        if not vehicle.left and vehicle.free_since_ns <= accepted.plan.depart_ns + LEAVE_NS:
            # Else it was not heard of when it was to leave, and may be back already.
            return
        if vehicle.reports_progress:
            # Its visits come apart from its positions: the last ones may be on their way.
            progress = vehicle.progress
            if progress is None or progress.cycle is not None:
                return
        else:
            for order in self._book.held_by(vehicle.id):
                self._claims.assume(vehicle, order, now_ns, f"{vehicle.id} is back")
        self.driven.finish(vehicle, now_ns)
        self.note(ended(accepted, "done", now_ns))
        if vehicle.offered is not None:
            self.drop_offer(vehicle, "superseded", now_ns, "its vehicle is back")
        vehicle.accepted, vehicle.left, vehicle.leg = None, False, 0
        vehicle.back_ns = now_ns
        self._book.release(vehicle.id, now_ns, f"{vehicle.id} came back with it", loaded=True)

    def take_back(self, vehicles: Iterable[TrackedVehicle], cycle: int, now_ns: int) -> None:
        """Take back the plans that nobody answers, or that nobody has left for."""
        for vehicle in vehicles:
            offered, accepted = vehicle.offered, vehicle.accepted
            if offered is not None:
                if not vehicle.has_telemetry:
                    if now_ns >= offered.plan.valid_until_ns:
                        self.drop(vehicle, offered, "lapsed", now_ns, "its plan has lapsed")
                elif _is_unanswered(vehicle, offered, now_ns):
                    vehicle.left_out_until = cycle + LEFT_OUT_CYCLES
                    reason = f"{vehicle.id} did not answer its plan"
                    if accepted is None:
                        self.drop(vehicle, offered, "lapsed", now_ns, reason)
                    else:
                        self.drop_offer(vehicle, "lapsed", now_ns, reason)
            if accepted is None or vehicle.left or not vehicle.is_fresh(now_ns):
                continue
            if now_ns > accepted.plan.depart_ns + LEAVE_NS and vehicle.free_since_ns is not None:
                reason = f"{vehicle.id} did not leave by its plan"
                self.drop(vehicle, accepted, "lapsed", now_ns, reason)
            elif not self._book.held_by(vehicle.id):
                self.drop(vehicle, accepted, "lapsed", now_ns, "it has no order left")

    def drop_offer(
        self, vehicle: TrackedVehicle, status: PlanStatus, now_ns: int, reason: str
    ) -> None:
        """The plan on offer is none any more; what the vehicle has acknowledged stays."""
        assert vehicle.offered is not None
        gone = ended(vehicle.offered, status, now_ns, reason)
        self.note(gone)
        vehicle.offered = None
        if vehicle.accepted is not None:
            # What the offer had beside it.
            self._book.keep_only(vehicle.accepted.plan, now_ns)
        if status == "lapsed":
            vehicle.withdrawn = gone

    def drop(
        self,
        vehicle: TrackedVehicle,
        record: PlanRecord,
        status: PlanStatus,
        now_ns: int,
        reason: str,
    ) -> None:
        """A vehicle that has not left has no plan any more, and its orders are open."""
        gone = ended(record, status, now_ns, reason)
        self.note(gone)
        vehicle.offered = vehicle.accepted = None
        vehicle.withdrawn, vehicle.leg = gone, 0
        self._book.release(vehicle.id, now_ns, reason)


def _is_unanswered(vehicle: TrackedVehicle, offered: PlanRecord, now_ns: int) -> bool:
    """Whether a plan on offer has to be taken back; see `ANSWER_NS`."""
    if vehicle.accepted is not None:
        return now_ns - offered.since_ns > ANSWER_NS
    if vehicle.is_fresh(now_ns):
        return vehicle.heard_ns - offered.since_ns > ANSWER_NS
    return now_ns >= offered.plan.valid_until_ns
