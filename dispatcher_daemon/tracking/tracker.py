"""The fleet's messages in; what a cycle may plan, and what has to be stored, out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from dispatcher_daemon.commitments import Commitment
from dispatcher_daemon.fleet import Fleet, Stop, Vehicle
from dispatcher_daemon.tracking.committing import commitment, is_at
from dispatcher_daemon.tracking.orders import OrderBook
from dispatcher_daemon.tracking.situation import Situation, cycle_fleet
from dispatcher_daemon.tracking.vehicle import TrackedVehicle, ended, loaded
from slipstream.messages import (
    OrderState,
    PlanAcknowledgement,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
)
from slipstream.orders import FleetRecords, PlanRecord, PlanStatus
from slipstream.roads import RoadNetwork

ANSWER_NS: Final = 5 * 10**9
"""A vehicle that reports, and not by then that it follows its new plan, does not: the plan is taken
back. That of a silent one is when it lapses: it may be on its way, with an answer that was lost."""
LEAVE_NS: Final = 60 * 10**9
"""So long after its departure a plan is taken back whose vehicle says that it follows none."""
LEFT_OUT_CYCLES: Final = 3
"""Cycles in which a vehicle that refused a plan, or did not answer it, is not planned."""
AT_DEPOT_M: Final = 100.0
"""A vehicle this near to its depot's junction stands in its yard."""
RESUME_NS: Final = 10 * 10**9
"""After a start, vehicles have this long to report before they count as never reporting."""
MAX_STRANGERS: Final = 2000
"""Reports that are kept of vehicles which no fleet file has listed yet."""


class FleetTracker:
    """Orders, plans and vehicles of one fleet, by what vehicles say of themselves.

    A vehicle that has never sent anything is planned from its depot in each cycle, as long as the
    fleet's file has it. Any other is planned when it says that it is free and stands at its depot,
    and is bound to a plan from the moment that it acknowledges it, or says that it follows it.
    Not safe for threads.

    Args:
        network: roads.
        records: of the run before.
        started_ns: UTC at the start.
    """

    def __init__(
        self, network: RoadNetwork, records: FleetRecords | None = None, started_ns: int = 0
    ) -> None:
        stored = records or FleetRecords()
        self._network = network
        self._started_ns = started_ns
        self.book = OrderBook(stored.orders)
        self._vehicles = {record.vehicle: loaded(record) for record in stored.vehicles}
        self._strangers: dict[tuple[str, str], VehiclePosition | VehicleProgress] = {}
        self._plans: dict[tuple[int, str], PlanRecord] = {}
        self._reported: set[str] = set()
        for record in stored.plans:
            self._resume(record)

    @property
    def vehicles(self) -> Mapping[str, TrackedVehicle]:
        """By id."""
        return self._vehicles

    def counts(self) -> dict[OrderState, int]:
        """Number of orders by state."""
        return self.book.counts()

    def silent(self, now_ns: int) -> tuple[str, ...]:
        """Vehicles that have reported before, and do not now."""
        return tuple(
            v.id for v in self._vehicles.values() if v.has_telemetry and not v.is_fresh(now_ns)
        )

    def on_position(self, position: VehiclePosition, now_ns: int) -> bool:
        """A position; False: on no road of the network."""
        if position.segment not in self._network.segments:
            return False
        vehicle = self._known(position)
        if vehicle is None:
            return True
        held = vehicle.position
        if not vehicle.is_news(None if held is None else held.time_ns, position.time_ns, now_ns):
            return True
        self._heard(vehicle, now_ns)
        was_free = vehicle.is_fresh(now_ns) and vehicle.free_since_ns is not None
        vehicle.position, vehicle.heard_ns = position, now_ns
        if position.cycle is not None or not self._is_home(vehicle):
            vehicle.free_since_ns = None
        elif not was_free:
            vehicle.free_since_ns = now_ns
        if position.cycle is not None:
            left = position.on_road or bool(position.leg)
            self._follows(vehicle, position.cycle, now_ns, left=left)
        accepted = vehicle.accepted
        if accepted is not None and position.cycle == accepted.plan.cycle:
            assert position.leg is not None
            self._drives(vehicle, accepted.plan, position.leg, now_ns)
        self._come_back(vehicle, now_ns)
        return True

    def on_acknowledgement(self, answer: PlanAcknowledgement, now_ns: int) -> None:
        """An answer to a plan. One to a plan that is not in force any more changes nothing, unless
        it accepts what was taken back.
        """
        vehicle = self._vehicles.get(answer.vehicle)
        if vehicle is None:
            return
        self._heard(vehicle, now_ns)
        if answer.accepted:
            self._follows(vehicle, answer.cycle, now_ns)
        elif vehicle.offered is not None and vehicle.offered.plan.cycle == answer.cycle:
            refused = ended(vehicle.offered, "refused", now_ns, answer.reason)
            self._note(refused)
            vehicle.offered = None
            if vehicle.accepted is None:
                self.book.release(
                    vehicle.id, now_ns, f"{vehicle.id} refused its plan: {answer.reason}"
                )
                vehicle.left_out_until = answer.cycle + 1 + LEFT_OUT_CYCLES
        elif (
            vehicle.accepted is not None
            and vehicle.accepted.plan.cycle == answer.cycle
            and not vehicle.left
        ):
            reason = f"{vehicle.id} gave its plan back: {answer.reason}"
            self._drop(vehicle, vehicle.accepted, "refused", now_ns, reason)
            vehicle.left_out_until = answer.cycle + 1 + LEFT_OUT_CYCLES

    def on_progress(self, progress: VehicleProgress, now_ns: int) -> None:
        """Visits, each as often as it comes."""
        vehicle = self._known(progress)
        if vehicle is None:
            return
        before = None if vehicle.progress is None else vehicle.progress.time_ns
        self._heard(vehicle, now_ns)
        vehicle.reports_progress = True
        for visit in progress.visits:
            self.book.visited(vehicle.id, visit, now_ns)
        if vehicle.is_news(before, progress.time_ns, now_ns):
            vehicle.progress = progress
            if progress.cycle is not None:
                self._follows(vehicle, progress.cycle, now_ns)
        visited = {visit.stop for visit in progress.visits}
        accepted = vehicle.accepted
        if accepted is not None and any(s.stop in visited for s in accepted.plan.service_stops):
            self._leave(vehicle, now_ns)
        self._come_back(vehicle, now_ns)

    def list_fleet(self, fleet: Fleet | None, now_ns: int) -> None:
        """Take over the fleet's file as it is now; None: it has no order, or no vehicle."""
        listed = () if fleet is None else fleet.vehicles
        for tracked in self._vehicles.values():
            tracked.listed = False
        for vehicle in listed:
            assert fleet is not None
            depot = fleet.depot_of(vehicle)
            known = self._vehicles.setdefault(vehicle.id, TrackedVehicle(vehicle, depot))
            if (known.definition, known.depot) != (vehicle, depot):
                known.definition, known.depot = vehicle, depot
                self._reported.add(vehicle.id)
            known.listed = True
        self.book.list_stops(() if fleet is None else fleet.stops, now_ns)
        for key in [key for key in self._strangers if key[0] in self._vehicles]:
            report = self._strangers.pop(key)
            if isinstance(report, VehiclePosition):
                self.on_position(report, now_ns)
            else:
                self.on_progress(report, now_ns)

    def situation(
        self, fleet: Fleet | None, cycle: int, now_ns: int, reference_s: float
    ) -> Situation:
        """What a cycle may plan. Plans that nobody answers, or that nobody left for, are taken
        back first.

        Args:
            fleet: of the file, as listed.
            cycle: its number.
            now_ns: its start, UTC.
            reference_s: from then to the moment that its plans are out, and that the fleet's times
                count from.
        """
        self._take_back(cycle, now_ns)
        reference_ns = now_ns + round(1e9 * reference_s)
        left_out: dict[str, str] = {}
        bound: list[Commitment] = []
        free: list[Vehicle] = []
        for vehicle in self._vehicles.values():
            reason = self._obstacle(vehicle, cycle, now_ns)
            if reason is not None:
                left_out[vehicle.id] = reason
            elif vehicle.accepted is not None:
                held = self._held(vehicle.id)
                bound.append(commitment(vehicle, held, now_ns, reference_ns))
            elif vehicle.listed:
                free.append(vehicle.charged())
        found = cycle_fleet(
            fleet,
            free,
            bound,
            self._vehicles,
            self.book.orders,
            lambda order: self._is_to_have(order, now_ns),
            reference_ns,
        )
        return Situation(found, tuple(bound), left_out)

    def admissible(self, plans: Iterable[VehiclePlan]) -> tuple[VehiclePlan, ...]:
        """The plans of a cycle that still fit: vehicles have reported while it ran."""
        return tuple(plan for plan in plans if self._fits(plan))

    def publish(
        self,
        plans: Sequence[VehiclePlan],
        stops: Mapping[str, Stop],
        reference_ns: int,
        now_ns: int,
    ) -> None:
        """Admissible plans of a cycle go out.

        Args:
            plans: each is on offer to its vehicle from now on.
            stops: of the cycle's fleet, by id.
            reference_ns: UTC that its times count from.
            now_ns: UTC.
        """
        for plan in plans:
            vehicle = self._vehicles[plan.vehicle]
            if vehicle.offered is not None:
                reason = f"by the plan of cycle {plan.cycle}"
                self._note(ended(vehicle.offered, "superseded", now_ns, reason))
            vehicle.offered = PlanRecord(plan, "published", now_ns)
            self._reported.add(vehicle.id)
            if vehicle.accepted is None:
                self.book.plan(plan, stops, reference_ns, now_ns)
        for plan in plans:
            if self._vehicles[plan.vehicle].accepted is None:
                self.book.keep_only(plan, now_ns)

    def retract(self, plans: Iterable[VehiclePlan], now_ns: int) -> None:
        """Plans that were to go out could not be stored, and did not."""
        for plan in plans:
            vehicle = self._vehicles[plan.vehicle]
            vehicle.offered = None
            if vehicle.accepted is None:
                self.book.release(plan.vehicle, now_ns, "its plan could not be stored")

    def pending_records(self) -> FleetRecords:
        """What has changed since `stored` was called last."""
        orders, changes = self.book.pending()
        return FleetRecords(
            orders,
            changes,
            tuple(self._plans.values()),
            tuple(self._vehicles[name].record() for name in sorted(self._reported)),
        )

    def mark_all(self) -> None:
        """All orders and vehicles are pending: the database is another one."""
        self.book.mark_all()
        self._reported = set(self._vehicles)

    def stored(self) -> None:
        """The pending records are in the database."""
        self.book.stored()
        self._plans, self._reported = {}, set()

    def _known(self, report: VehiclePosition | VehicleProgress) -> TrackedVehicle | None:
        """The vehicle of a report; one that nobody has listed yet is kept for later."""
        vehicle = self._vehicles.get(report.vehicle)
        key = report.vehicle, type(report).__name__
        if vehicle is None and (key in self._strangers or len(self._strangers) < MAX_STRANGERS):
            self._strangers[key] = report
        return vehicle

    def _heard(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        vehicle.answered_ns = now_ns
        self._reported.add(vehicle.id)

    def _note(self, record: PlanRecord) -> None:
        self._plans[record.plan.cycle, record.plan.vehicle] = record

    def _held(self, vehicle: str) -> frozenset[str]:
        return frozenset(self.book.held_by(vehicle))

    def _follows(
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
            to_have = any(self._is_to_have(stop, now_ns) for stop in stops)
            if accepted is None and not left and not to_have:
                return
            if offered is not None:
                self._drop_offer(vehicle, "superseded", now_ns, "its vehicle follows another plan")
                if accepted is None:
                    self.book.release(vehicle.id, now_ns, f"{vehicle.id} follows another plan")
            vehicle.offered, vehicle.withdrawn = withdrawn, None
        for record in vehicle.accept(now_ns):
            self._note(record)
        assert vehicle.accepted is not None
        for stop in vehicle.accepted.plan.service_stops:
            if self._is_to_have(stop.stop, now_ns):
                self.book.assign(stop.stop, vehicle.id, cycle, now_ns)

    def _drives(self, vehicle: TrackedVehicle, plan: VehiclePlan, leg: int, now_ns: int) -> None:
        """A vehicle is on a leg of its plan, or will drive it next."""
        assert vehicle.position is not None
        vehicle.leg = max(vehicle.leg, min(leg, len(plan.stops) - 2))
        if vehicle.position.on_road or vehicle.leg > 0:
            self._leave(vehicle, now_ns)
        if not vehicle.reports_progress and vehicle.left:
            passed = vehicle.leg + 1 if vehicle.position.on_road else vehicle.leg
            for stop in plan.stops[:passed]:
                reason = f"{vehicle.id} has driven on"
                self.book.assume_served(vehicle.id, stop.stop, now_ns, reason)

    def _leave(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        assert vehicle.accepted is not None
        vehicle.left = True
        self.book.leave(vehicle.id, vehicle.accepted.plan.service_stops, now_ns)

    def _come_back(self, vehicle: TrackedVehicle, now_ns: int) -> None:
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
            for order in self.book.held_by(vehicle.id):
                self.book.assume_served(vehicle.id, order, now_ns, f"{vehicle.id} is back")
        self._note(ended(accepted, "done", now_ns))
        if vehicle.offered is not None:
            self._drop_offer(vehicle, "superseded", now_ns, "its vehicle is back")
        vehicle.accepted, vehicle.left, vehicle.leg = None, False, 0
        self.book.release(vehicle.id, now_ns, f"{vehicle.id} came back with it", loaded=True)

    def _is_home(self, vehicle: TrackedVehicle) -> bool:
        """Whether it stands at its depot."""
        position = vehicle.position
        if position is None or position.on_road:
            return False
        segment, home = self._network.segments[position.segment], vehicle.depot.node
        if (position.share == 1.0 and segment.end == home) or (
            position.share == 0.0 and segment.start == home
        ):
            return True
        at = self._network.junctions
        return is_at(at[home], (at[segment.start], at[segment.end]), position.share, AT_DEPOT_M)

    def _obstacle(self, vehicle: TrackedVehicle, cycle: int, now_ns: int) -> str | None:
        """Why a vehicle is not planned; None: it is."""
        if not vehicle.has_telemetry:
            return "has a plan of the run before" if self._may_be_gone(vehicle, now_ns) else None
        if not vehicle.is_fresh(now_ns):
            return "silent"
        if vehicle.offered is not None:
            return "has not answered its plan yet"
        if cycle < vehicle.left_out_until:
            return "refused its plan, or did not answer it"
        assert vehicle.position is not None
        if vehicle.accepted is not None:
            if vehicle.position.cycle not in (None, vehicle.accepted.plan.cycle):
                return "follows another plan than it has acknowledged"
            if vehicle.free_since_ns is not None:
                return "is about to leave, or its last visits are not known yet"
            if vehicle.is_to_charge:
                return "is on its way to charge, or charges"
            return None
        if not self._is_free(vehicle):
            return "follows a plan that is not known, or is not at its depot"
        return None

    def _may_be_gone(self, vehicle: TrackedVehicle, now_ns: int) -> bool:
        """Whether it may have left by a plan of the run before, and have had no time to say so."""
        return (
            vehicle.offered is not None
            and vehicle.offered.since_ns < self._started_ns
            and now_ns - self._started_ns < RESUME_NS
        )

    def _is_free(self, vehicle: TrackedVehicle) -> bool:
        """Whether it stands at its depot and follows no plan but one that was taken back."""
        assert vehicle.position is not None
        withdrawn = None if vehicle.withdrawn is None else vehicle.withdrawn.plan.cycle
        return vehicle.position.cycle in (None, withdrawn) and self._is_home(vehicle)

    def _take_back(self, cycle: int, now_ns: int) -> None:
        for vehicle in self._vehicles.values():
            offered, accepted = vehicle.offered, vehicle.accepted
            if offered is not None:
                if not vehicle.has_telemetry:
                    if now_ns >= offered.plan.valid_until_ns:
                        self._drop(vehicle, offered, "lapsed", now_ns, "its plan has lapsed")
                elif _is_unanswered(vehicle, offered, now_ns):
                    vehicle.left_out_until = cycle + LEFT_OUT_CYCLES
                    reason = f"{vehicle.id} did not answer its plan"
                    if accepted is None:
                        self._drop(vehicle, offered, "lapsed", now_ns, reason)
                    else:
                        self._drop_offer(vehicle, "lapsed", now_ns, reason)
            if accepted is None or vehicle.left or not vehicle.is_fresh(now_ns):
                continue
            if now_ns > accepted.plan.depart_ns + LEAVE_NS and vehicle.free_since_ns is not None:
                reason = f"{vehicle.id} did not leave by its plan"
                self._drop(vehicle, accepted, "lapsed", now_ns, reason)
            elif not self.book.held_by(vehicle.id):
                self._drop(vehicle, accepted, "lapsed", now_ns, "it has no order left")

    def _drop_offer(
        self, vehicle: TrackedVehicle, status: PlanStatus, now_ns: int, reason: str
    ) -> None:
        """The plan on offer is none any more; what the vehicle has acknowledged stays."""
        assert vehicle.offered is not None
        gone = ended(vehicle.offered, status, now_ns, reason)
        self._note(gone)
        vehicle.offered = None
        if status == "lapsed":
            vehicle.withdrawn = gone

    def _drop(
        self,
        vehicle: TrackedVehicle,
        record: PlanRecord,
        status: PlanStatus,
        now_ns: int,
        reason: str,
    ) -> None:
        """A vehicle that has not left has no plan any more, and its orders are open."""
        gone = ended(record, status, now_ns, reason)
        self._note(gone)
        vehicle.offered = vehicle.accepted = None
        vehicle.withdrawn, vehicle.leg = gone, 0
        self.book.release(vehicle.id, now_ns, reason)

    def _fits(self, plan: VehiclePlan) -> bool:
        vehicle = self._vehicles.get(plan.vehicle)
        if vehicle is None:
            return False
        stops = [stop.stop for stop in plan.service_stops]
        if vehicle.accepted is not None:
            # Its next version: nothing that it did not hold when the cycle began.
            known = {stop.stop for stop in vehicle.accepted.plan.stops}
            started = plan.continues == vehicle.accepted.plan.cycle
            return (started or not vehicle.left) and known.issuperset(stops)
        if plan.continues is not None:
            return False
        if vehicle.has_telemetry and not (vehicle.offered is None and self._is_free(vehicle)):
            return False
        return all(self._is_to_have(stop, plan.issued_ns) for stop in stops)

    def _is_to_have(self, stop: str, now_ns: int) -> bool:
        """Whether an order is open, or planned for a vehicle that never answers."""
        order = self.book.orders.get(stop)
        if order is None or order.state not in ("open", "planned"):
            return False
        if order.state == "open" or order.vehicle is None:
            return True
        holder = self._vehicles.get(order.vehicle)
        return holder is None or not (holder.has_telemetry or self._may_be_gone(holder, now_ns))

    def _resume(self, record: PlanRecord) -> None:
        vehicle = self._vehicles.get(record.plan.vehicle)
        if vehicle is None:
            return
        if record.status == "lapsed":
            vehicle.withdrawn = record
        elif record.status == "published":
            vehicle.offered = record
        else:
            vehicle.accepted = record
            vehicle.left = record.plan.continues is not None or any(
                self.book.orders[order].state == "under_way"
                for order in self.book.held_by(vehicle.id)
            )


def _is_unanswered(vehicle: TrackedVehicle, offered: PlanRecord, now_ns: int) -> bool:
    """Whether a plan on offer has to be taken back; see `ANSWER_NS`."""
    if vehicle.accepted is not None:
        return now_ns - offered.since_ns > ANSWER_NS
    if vehicle.is_fresh(now_ns):
        return vehicle.heard_ns - offered.since_ns > ANSWER_NS
    return now_ns >= offered.plan.valid_until_ns
