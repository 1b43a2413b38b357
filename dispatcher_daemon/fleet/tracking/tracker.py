"""The fleet's messages in; what a cycle may plan, and what has to be stored, out."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

from dispatcher_daemon.fleet.commitments import Commitment
from dispatcher_daemon.fleet.models import Fleet
from dispatcher_daemon.fleet.road_users import on_road
from dispatcher_daemon.fleet.stops import Stop
from dispatcher_daemon.fleet.tracking.availability import Availability
from dispatcher_daemon.fleet.tracking.claims import Claims
from dispatcher_daemon.fleet.tracking.committing import behind_s, commitment
from dispatcher_daemon.fleet.tracking.open_tours import OpenTour, open_tours
from dispatcher_daemon.fleet.tracking.order_stops import (
    NOT_YET,
    is_bundled,
    outside_windows,
    requested_stops,
)
from dispatcher_daemon.fleet.tracking.orders import OrderBook
from dispatcher_daemon.fleet.tracking.plan_life import PlanLife
from dispatcher_daemon.fleet.tracking.sightings import Sighting, VehicleSightings, where
from dispatcher_daemon.fleet.tracking.situation import (
    FleetSituation,
    cycle_fleet,
    idle_text,
    nobody_free,
)
from dispatcher_daemon.fleet.tracking.vehicle import TrackedVehicle, loaded
from dispatcher_daemon.fleet.vehicles import Vehicle
from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import (
    OrderState,
    PlanAcknowledgement,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
)
from slipstream.orders import FleetRecords, OrderRecord, PlanChange, PlanRecord, utc
from slipstream.roads import RoadNetwork

MAX_STRANGERS: Final = 2000
"""Reports that are kept of vehicles which no fleet file has listed yet."""


class FleetTracker:
    """Orders, plans and vehicles of one fleet, by what vehicles say of themselves.

    A vehicle that has never sent anything is planned from its depot in each cycle, as long as the
    fleet's file has it. Any other is planned when it says that it is free and stands at its depot,
    and is bound to a plan from the moment that it acknowledges it, or says that it follows it.
    Not safe for threads.
    """

    def __init__(
        self,
        network: RoadNetwork,
        records: FleetRecords | None = None,
        started_ns: int = 0,
        plan_ahead_s: float = 0.0,
        bundle_s: float = 0.0,
    ) -> None:
        stored = records or FleetRecords()
        self._network, self._plan_ahead_s, self._bundle_s = network, plan_ahead_s, bundle_s
        self.unplanned: Mapping[str, str] = {}
        self.book = OrderBook(stored.orders)
        self._before_plans = self.book.mark(())
        self.claims = Claims(self.book, network)
        self._life = PlanLife(self.book, self.claims, self._may_have)
        self._available = Availability(network, started_ns)
        self._vehicles = {record.vehicle: loaded(record) for record in stored.vehicles}
        self._strangers: dict[tuple[str, str], VehiclePosition | VehicleProgress] = {}
        self._reported: set[str] = set()
        for vehicle in self._vehicles.values():
            position = vehicle.position
            if position is not None and position.segment in network.segments:
                seen = Sighting(position.time_ns, where(network, position))
                vehicle.sightings = VehicleSightings(seen)
        for record in stored.plans:
            self._resume(record)

    @property
    def vehicles(self) -> Mapping[str, TrackedVehicle]:
        """By id."""
        return self._vehicles

    def counts(self) -> dict[OrderState, int]:
        """Number of orders by state."""
        return self.book.counts()

    def arrival_ns(self, order: OrderRecord) -> int | None:
        """When the plan with an order has its vehicle there, UTC; None: none has it."""
        vehicle = None if order.vehicle is None else self._vehicles.get(order.vehicle)
        if vehicle is None or order.ended:
            return None
        records = (vehicle.accepted, vehicle.offered)
        stops = (stop for record in records if record for stop in record.plan.service_stops)
        return next((stop.arrival_ns for stop in stops if stop.stop == order.order), None)

    @property
    def plan_changes(self) -> tuple[PlanChange, ...]:
        """Changes of plans' statuses since `stored` was called last."""
        return self._life.changes

    def silent(self, now_ns: int) -> tuple[TrackedVehicle, ...]:
        """Vehicles that have reported before, and do not now."""
        return tuple(
            v for v in self._vehicles.values() if v.has_telemetry and not v.is_fresh(now_ns)
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
        vehicle.sightings.take(position, self._network, self._places(vehicle))
        if position.cycle is not None or not self._available.is_home(vehicle):
            vehicle.free_since_ns = None
        elif not was_free:
            vehicle.free_since_ns = now_ns
        if position.cycle is not None:
            left = position.on_road or bool(position.leg)
            self._life.follows(vehicle, position.cycle, now_ns, left=left)
        accepted = vehicle.accepted
        if accepted is not None and position.cycle == accepted.plan.cycle:
            assert position.leg is not None
            self._life.drives(vehicle, accepted.plan, position.leg, now_ns)
        self.claims.settle(vehicle, now_ns)
        self._life.come_back(vehicle, now_ns)
        return True

    def on_acknowledgement(self, answer: PlanAcknowledgement, now_ns: int) -> None:
        """An answer to a plan. One to a plan that is not in force any more changes nothing, unless
        it accepts what was taken back.
        """
        vehicle = self._vehicles.get(answer.vehicle)
        if vehicle is None:
            return
        self._heard(vehicle, now_ns)
        before = None if vehicle.answer is None else vehicle.answer.time_ns
        if vehicle.is_news(before, answer.time_ns, now_ns):
            vehicle.answer = answer
        if answer.accepted:
            self._life.follows(vehicle, answer.cycle, now_ns)
        else:
            self._life.refused(vehicle, answer, now_ns)

    def on_progress(self, progress: VehicleProgress, now_ns: int) -> None:
        """Visits, each as often as it comes."""
        vehicle = self._known(progress)
        if vehicle is None:
            return
        before = None if vehicle.progress is None else vehicle.progress.time_ns
        self._heard(vehicle, now_ns)
        vehicle.reports_progress = True
        self.claims.tell(vehicle, progress.visits, now_ns)
        if vehicle.is_news(before, progress.time_ns, now_ns):
            if progress.cycle is not None:
                self._life.follows(vehicle, progress.cycle, now_ns)
            vehicle.progress = self._of_now(vehicle, progress)
        visited = {visit.stop for visit in progress.visits}
        accepted = vehicle.accepted
        if accepted is not None and any(
            stop.stop in visited and self._has_been_at(vehicle, stop.stop)
            for stop in accepted.plan.service_stops
        ):
            self._life.leave(vehicle, now_ns)
        self._life.come_back(vehicle, now_ns)

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
    ) -> FleetSituation:
        """What a cycle may plan. Plans that nobody answers, or that nobody left for, are taken
        back first.

        Args:
            reference_s: from then to the moment that its plans are out, and that the fleet's times
                count from.
        """
        self._life.take_back(self._vehicles.values(), cycle, now_ns)
        self.book.expire(now_ns)
        reference_ns = now_ns + round(1e9 * reference_s)
        left_out: dict[str, str] = {}
        kept: list[TrackedVehicle] = []
        bound: list[Commitment] = []
        free: list[Vehicle] = []
        for vehicle in self._vehicles.values():
            reason = self._available.obstacle(vehicle, cycle, now_ns)
            if reason is not None:
                left_out[vehicle.id] = reason
                if vehicle.keeps_its_plan and vehicle.is_fresh(now_ns):
                    kept.append(vehicle)
            elif vehicle.accepted is not None:
                held = self.book.held_by(vehicle.id)
                bound.append(commitment(vehicle, held, now_ns, reference_ns))
            elif vehicle.listed:
                free.append(vehicle.plannable(reference_ns))

        orders, windows = self.book.orders, (reference_ns, self._plan_ahead_s)
        found_outside = {} if fleet is None else outside_windows(fleet, *windows)
        # A caller's order hides a stop of the file with its id.
        outside = {k: why for k, why in found_outside.items() if orders[k].request is None}

        def may_plan(order: str) -> bool:
            return order not in outside and self._may_have(order, now_ns)

        requested, kept_back = requested_stops(
            self.book.orders.values(),
            may_plan,
            fleet,
            self._network.junctions,
            reference_ns,
            self._plan_ahead_s,
            self._bundle_s,
        )
        self.unplanned = {**outside, **kept_back}
        found = cycle_fleet(
            fleet,
            free,
            bound,
            self._vehicles,
            self.book.orders,
            may_plan,
            reference_ns,
            requested,
        )
        idle = {name: why for name, why in left_out.items() if self._has_no_plan(name)}
        nobody = nobody_free(fleet, left_out, len(bound)) + idle_text(idle)
        waiting = self._waiting(found, nobody, now_ns)
        open_now = {n: why for n, why in waiting.items() if orders[n].state == "open"}
        self.unplanned = {**open_now, **self.unplanned}
        plans = [vehicle.accepted.plan for vehicle in kept if vehicle.accepted is not None]
        late_s = {vehicle.id: behind_s(vehicle, now_ns) for vehicle in kept}
        listed = () if fleet is None else fleet.stops
        hidden = tuple(stop.id for stop in listed if orders[stop.id].request is not None)
        road_users = on_road(plans, now_ns, late_s)
        own = tuple(bound)
        later = {n: why for n, why in self.unplanned.items() if why.startswith(NOT_YET)}
        return FleetSituation(
            found, own, left_out, road_users, hidden, waiting, later, idle, nobody
        )

    def _has_no_plan(self, vehicle: str) -> bool:
        known = self._vehicles[vehicle]
        return known.offered is None and known.accepted is None

    def _waiting(self, found: Fleet | None, nobody: str, now_ns: int) -> dict[str, str]:
        """Reason by order that is due and not in a cycle's fleet, although nobody serves it as far
        as is known.
        """
        planned = {} if found is None else found.stop_by_id
        waiting: dict[str, str] = {}
        for name, order in self.book.orders.items():
            if order.ended or name in planned:
                continue
            vehicle = None if order.vehicle is None else self._vehicles.get(order.vehicle)
            if order.state == "open":
                reason = self.unplanned.get(name, nobody)
                if not reason.startswith(NOT_YET):
                    waiting[name] = reason
            elif vehicle is not None and vehicle.answered_ns and not vehicle.is_fresh(now_ns):
                since = utc(vehicle.answered_ns)
                waiting[name] = f"{vehicle.id}, which has it, is silent since {since}"
        return waiting

    def insertion(
        self,
        fleet: Fleet | None,
        wanted: Collection[str],
        cycle: int,
        now_ns: int,
        reference_s: float,
    ) -> tuple[list[OpenTour], list[Stop]]:
        """(tours that have not begun, those of some orders that are open and may be planned); as
        `situation`, between cycles.
        """
        reference_ns = now_ns + round(1e9 * reference_s)
        stops, kept = requested_stops(
            [self.book.orders[name] for name in wanted if name in self.book.orders],
            lambda name: self.book.orders[name].state == "open",
            fleet,
            self._network.junctions,
            reference_ns,
            self._plan_ahead_s,
            bundle_s=0.0,
        )
        self.unplanned = {**self.unplanned, **kept}
        vehicles = self._vehicles.values()
        tours = open_tours(fleet, vehicles, self._available, self.book, cycle, now_ns, reference_ns)
        orders = self.book.orders
        if all(is_bundled(orders[stop.id], reference_ns, self._bundle_s) for stop in stops):
            # Others may join them: they are no reason to send an idle vehicle.
            tours = (tour for tour in tours if tour.stops)
        return list(tours) if stops else [], stops

    def settle(self, order: str, now_ns: int, *, served: bool, reason: str | None = None) -> None:
        """Somebody who knows says whether an order was served: what vehicles said of it is past."""
        self.book.settle(order, now_ns, served=served, reason=reason)
        self.claims.forget(order)
        for vehicle in self._vehicles.values():
            vehicle.given.pop(order, None)

    def skip_number(self, cycle: int) -> None:
        """A number was used between cycles: for vehicles that are left out of some, it is none."""
        for vehicle in self._vehicles.values():
            if vehicle.left_out_until > cycle:
                vehicle.left_out_until += 1

    def admissible(self, plans: Iterable[VehiclePlan]) -> tuple[VehiclePlan, ...]:
        """The plans of a cycle that still fit: vehicles have reported while it ran."""
        return tuple(plan for plan in plans if self._fits(plan))

    def publish(
        self,
        plans: Sequence[VehiclePlan],
        stops: Mapping[str, Stop],
        reference_ns: int,
        now_ns: int,
        energies: Mapping[str, PlanEnergy] | None = None,
    ) -> None:
        """Admissible plans of a cycle go out, and what was driven until now is booked."""
        for vehicle in self._vehicles.values():
            self._life.driven.advance(vehicle, now_ns)
            for name in [name for name in vehicle.given if self._is_over(name)]:
                del vehicle.given[name]
        names = [stop.stop for plan in plans for stop in plan.service_stops]
        self._before_plans = self.book.mark(names)
        for plan in plans:
            vehicle = self._vehicles[plan.vehicle]
            energy = None if energies is None else energies.get(plan.vehicle)
            self._life.offer(vehicle, plan, now_ns, energy)
            self._reported.add(vehicle.id)
            before = None if vehicle.accepted is None else vehicle.accepted.plan
            self.book.plan(plan, stops, reference_ns, now_ns, before)
        for plan in plans:
            if self._vehicles[plan.vehicle].accepted is None:
                self.book.keep_only(plan, now_ns)

    def retract(self, plans: Collection[VehiclePlan], now_ns: int) -> None:
        """Plans that were to go out could not be stored, and did not."""
        self._life.retract(plans)
        for plan in plans:
            vehicle = self._vehicles[plan.vehicle]
            vehicle.offered = None
            if vehicle.accepted is None:
                self.book.release(plan.vehicle, now_ns, "its plan could not be stored")
            else:
                self.book.keep_only(vehicle.accepted.plan, now_ns)
        self.book.undo(self._before_plans)

    def pending_records(self) -> FleetRecords:
        """What has changed since `stored` was called last."""
        orders, changes = self.book.pending()
        return FleetRecords(
            orders,
            changes,
            self._life.pending,
            tuple(self._vehicles[name].record() for name in sorted(self._reported)),
            driven=self._life.driven.pending,
            plan_changes=self._life.changes,
        )

    def mark_all(self) -> None:
        """All orders and vehicles are pending: the database is another one."""
        self.book.mark_all()
        self._reported = set(self._vehicles)

    def stored(self) -> None:
        """The pending records are in the database."""
        self.book.stored()
        self._life.stored()
        self._reported = set()

    def _known(self, report: VehiclePosition | VehicleProgress) -> TrackedVehicle | None:
        """The vehicle of a report; one that nobody has listed yet is kept for later."""
        vehicle = self._vehicles.get(report.vehicle)
        key = report.vehicle, type(report).__name__
        if vehicle is None and (key in self._strangers or len(self._strangers) < MAX_STRANGERS):
            self._strangers[key] = report
        return vehicle

    def _of_now(self, vehicle: TrackedVehicle, progress: VehicleProgress) -> VehicleProgress:
        """A report without the visits of past tours, which it repeats by the hundred."""
        records = (vehicle.offered, vehicle.accepted, vehicle.withdrawn)
        own = {stop.stop for record in records if record for stop in record.plan.stops}
        visits = (one for one in progress.visits if one.stop in own or not self._is_over(one.stop))
        return progress.model_copy(update={"visits": tuple(visits)})

    def _has_been_at(self, vehicle: TrackedVehicle, stop: str) -> bool:
        order = self.book.orders.get(stop)
        own = order is not None and order.vehicle == vehicle.id
        return own and order is not None and order.state in ("under_way", "served", "failed")

    def _is_over(self, name: str) -> bool:
        """Whether nothing that is said of an order counts any more."""
        order = self.book.orders.get(name)
        return order is None or order.state in ("served", "failed")

    def _places(self, vehicle: TrackedVehicle) -> dict[str, str]:
        """Junctions of a vehicle's orders that may still end."""
        orders = self.book.orders
        return {name: orders[name].node for name in vehicle.given if not self._is_over(name)}

    def _heard(self, vehicle: TrackedVehicle, now_ns: int) -> None:
        vehicle.answered_ns = now_ns
        self._reported.add(vehicle.id)

    def _fits(self, plan: VehiclePlan) -> bool:
        vehicle = self._vehicles.get(plan.vehicle)
        if vehicle is None:
            return False
        stops = [stop.stop for stop in plan.service_stops]
        if vehicle.accepted is not None:
            # Its next version: once it has left, nothing that it does not have with it.
            known = {stop.stop for stop in vehicle.accepted.plan.stops}
            if plan.continues == vehicle.accepted.plan.cycle:
                return known.issuperset(stops)
            stops = [stop for stop in stops if stop not in known]
            return not vehicle.left and self._may_give(stops, plan)
        if plan.continues is not None:
            return False
        if vehicle.has_telemetry and not (
            vehicle.offered is None and self._available.is_free(vehicle)
        ):
            return False
        return self._may_give(stops, plan)

    def _may_give(self, stops: Iterable[str], plan: VehiclePlan) -> bool:
        """Whether orders are there for the vehicle of a plan."""
        return all(
            self._may_have(stop, plan.issued_ns)
            and self.book.orders[stop].pinned in (None, plan.vehicle)
            for stop in stops
        )

    def _may_have(self, stop: str, now_ns: int) -> bool:
        """Whether an order is open, or planned for a vehicle that never answers."""
        order = self.book.orders.get(stop)
        if order is None or order.state not in ("open", "planned"):
            return False
        if order.state == "open" or order.vehicle is None:
            return True
        holder = self._vehicles.get(order.vehicle)
        return holder is None or not (
            holder.has_telemetry or self._available.may_be_gone(holder, now_ns)
        )

    def _resume(self, record: PlanRecord) -> None:
        vehicle = self._vehicles.get(record.plan.vehicle)
        if vehicle is None:
            return
        for stop in record.plan.stops:
            vehicle.given.setdefault(stop.stop, record.plan.issued_ns)
        if record.status == "lapsed":
            vehicle.withdrawn = record
        elif record.status == "published":
            vehicle.offered = record
        else:
            vehicle.accepted = record
            own = {stop.stop for stop in record.plan.stops}
            vehicle.left = record.plan.continues is not None or any(
                self.book.orders[order].state == "under_way"
                for order in own.intersection(self.book.held_by(vehicle.id))
            )
