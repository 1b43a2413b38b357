"""The fleet's messages from the bus, and the tracker between the bus's threads and the cycle's."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final, NamedTuple, TypeVar

from dispatcher_daemon.fleet import Fleet, Stop
from dispatcher_daemon.fleet.learning import Learned, Learning
from dispatcher_daemon.fleet.tracking import (
    FRESH_NS,
    FleetSituation,
    FleetTracker,
    TrackedVehicle,
)
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.energy.ledger import PlanEnergy
from slipstream.errors import InputError
from slipstream.messages import (
    OrderState,
    PlanAcknowledgement,
    SilentVehicle,
    VehiclePlan,
    VehiclePosition,
    VehicleProgress,
    acknowledgement_key,
    decode,
    position_key,
    progress_key,
)
from slipstream.orders import FleetRecords, PlanChange
from slipstream.roads import RoadNetwork
from slipstream.service.tracing import traced

T = TypeVar("T")
VehicleReport = VehiclePosition | PlanAcknowledgement | VehicleProgress
"""What vehicles say of themselves."""
_COPY_WITHIN_S: Final = 0.1
"""A caller of the API waits no longer for a cycle that is being stored, s."""
Save = Callable[[tuple[VehiclePlan, ...], FleetRecords], None]


@dataclass(frozen=True)
class FleetCopy:
    """The tracked vehicles at one moment.

    Attributes:
        vehicles: by id, which they are sorted by; nobody changes them any more.
        plan_changes: of plans' statuses that were not stored yet.
        orders: that each has by its plan, or has left with.
    """

    time_ns: int
    vehicles: Mapping[str, TrackedVehicle]
    plan_changes: tuple[PlanChange, ...] = ()
    orders: Mapping[str, int] = field(default_factory=dict)


class FleetFigures(NamedTuple):
    """The fleet in figures.

    Attributes:
        silent: vehicles that have reported before, and do not now.
        unheard: vehicles that have orders and have never reported.
    """

    reporting: int = 0
    silent: tuple[SilentVehicle, ...] = ()
    orders: Mapping[OrderState, int] = MappingProxyType({})
    unheard: tuple[str, ...] = ()


class FleetWatch:
    """The tracked fleet; safe for threads.

    Args:
        learning: in place of that from the fleet's positions and the states.

    Attributes:
        fleet: of the file, as the last cycle has read it.
    """

    def __init__(
        self,
        network: RoadNetwork,
        records: FleetRecords,
        started_ns: int,
        clock: Callable[[], int],
        refuse: Callable[[InputError], None],
        plan_ahead_s: float = 0.0,
        bundle_s: float = 0.0,
        learning: Learning | None = None,
    ) -> None:
        self.fleet: Fleet | None = None
        self._tracker = FleetTracker(network, records, started_ns, plan_ahead_s, bundle_s)
        self._learning = learning or Learning(network, records)
        self._lock = threading.Lock()
        self._clock, self._refuse = clock, refuse
        self._copy = FleetCopy(started_ns, {})
        self._on_bus: dict[str, int] = {}
        self._figures = FleetFigures()
        self.vehicles()

    def on_position(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_POSITIONS`."""
        self._receive(VehiclePosition, position_key, key, payload)

    def on_acknowledgement(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_ACKNOWLEDGEMENTS`."""
        self._receive(PlanAcknowledgement, acknowledgement_key, key, payload)

    def on_progress(self, key: str, payload: bytes) -> None:
        """Take in one message from `ALL_PROGRESS`."""
        self._receive(VehicleProgress, progress_key, key, payload)

    def take(self, report: VehicleReport, source: str) -> None:
        """Take in what a vehicle says of itself, whichever way it came.

        Raises:
            InputError: it is on a segment that the network does not have.
        """
        with self._lock:
            now_ns = self._clock()
            if isinstance(report, PlanAcknowledgement):
                self._tracker.on_acknowledgement(report, now_ns)
            elif isinstance(report, VehicleProgress):
                self._tracker.on_progress(report, now_ns)
            elif not self._tracker.on_position(report, now_ns):
                unknown = f"unknown segment {report.segment!r}"
                mend = "give the vehicle this network"
                raise InputError(source, unknown, mend, key="segment")
            elif report.vehicle in self._tracker.vehicles:
                self._learning.on_position(report)

    def knows(self, vehicle: str) -> bool:
        """Whether the fleet has a vehicle, or had it and it may still be under way."""
        fleet = self.fleet
        if fleet is not None and vehicle in fleet.vehicle_by_id:
            return True
        with self._lock:
            return vehicle in self._tracker.vehicles

    def situation(
        self, fleet: Fleet | None, cycle: int, now_ns: int, reference_s: float
    ) -> FleetSituation:
        """The fleet's file as it is now, and what a cycle may plan; see `FleetTracker`."""
        self.fleet = fleet
        with self._lock:
            self._tracker.list_fleet(fleet, now_ns)
            return self._tracker.situation(fleet, cycle, now_ns, reference_s)

    @traced("store")
    def store(
        self,
        plans: tuple[VehiclePlan, ...],
        stops: Mapping[str, Stop],
        reference_ns: int,
        save: Save,
        energies: Mapping[str, PlanEnergy] | None = None,
    ) -> tuple[VehiclePlan, ...]:
        """Store a cycle's plans with what has changed of the fleet; the plans that may go out.

        Args:
            plans: of the cycle; some may not fit any more.
            save: stores them or raises; then nothing has happened.
        """
        with self._lock:
            tracker, now_ns = self._tracker, self._clock()
            plans = tracker.admissible(plans)
            tracker.publish(plans, stops, reference_ns, now_ns, energies)
            try:
                save(plans, self._learning.pending(tracker.pending_records()))
            except Exception:
                tracker.retract(plans, now_ns)
                raise
            tracker.stored()
            self._learning.stored()
        return plans

    def read(self, read: Callable[[FleetTracker], T]) -> T:
        """What a function finds or does in the tracker, which it must not keep."""
        with self._lock:
            return read(self._tracker)

    def edit(self, edit: Callable[[FleetTracker], T], save: Callable[[FleetRecords], None]) -> T:
        """What a function that changes orders returns, once the changes are stored. If it or
        ``save`` raises, nothing has happened.
        """
        with self._lock, self._tracker.book.stored_at_once(save):
            return edit(self._tracker)

    def note_unserved(self, unserved: Mapping[str, str]) -> None:
        """Reason by order that the last cycle has not planned, beside those that were kept back."""
        with self._lock:
            self._tracker.unplanned = {**self._tracker.unplanned, **unserved}

    def expected(self, snapshot: TrafficSnapshot) -> TrafficSnapshot:
        """The traffic of a cycle with what was learned until now, which it adds to: usual speeds
        where no state is fresh, how often gates are open, and what movements cost if the fleet has
        driven enough.
        """
        with self._lock:
            self._learning.on_traffic(snapshot)
            learned = self._learning.learned(snapshot.now_ns)
        return learned.onto(snapshot)

    def count_drives(self) -> None:
        """Learn from the drives that have ended; `expected` does so for a cycle."""
        with self._lock:
            self._learning.count_drives()

    def learned(self, now_ns: int) -> Learned:
        """What was learned until now, which nothing is added to."""
        with self._lock:
            return self._learning.learned(now_ns)

    def vehicles(self) -> FleetCopy:
        """The vehicles now; while a cycle is being stored, as they were before that."""
        self._copy = self.read_soon(self._copied) or self._copy
        return self._copy

    def _copied(self, tracker: FleetTracker) -> FleetCopy:
        copies = {name: replace(one) for name, one in sorted(tracker.vehicles.items())}
        held = {name: len(tracker.book.held_by(name)) for name in copies}
        return FleetCopy(self._clock(), copies, tracker.plan_changes, held)

    def speaks_itself(self, vehicle: str) -> bool:
        """Whether a vehicle is heard on the bus now, on the keys of its own agent."""
        with self._lock:
            heard_ns = self._on_bus.get(vehicle)
            return heard_ns is not None and self._clock() - heard_ns <= FRESH_NS

    def silent(self) -> tuple[TrackedVehicle, ...]:
        """Vehicles that have reported before, in an earlier run perhaps, and do not now."""
        return self.read(lambda tracker: tracker.silent(self._clock()))

    def now_ns(self) -> int:
        """UTC now, by the clock that reports are dated with."""
        return self._clock()

    def figures(self) -> FleetFigures:
        """The fleet now; while a cycle is being stored, as it was before that."""
        self._figures = self.read_soon(self._count) or self._figures
        return self._figures

    def _count(self, tracker: FleetTracker) -> FleetFigures:
        held = {name: len(tracker.book.held_by(name)) for name in tracker.vehicles}
        return FleetFigures(
            sum(vehicle.has_telemetry for vehicle in tracker.vehicles.values()),
            tuple(
                SilentVehicle(
                    vehicle=one.id,
                    heard_ns=one.answered_ns or 0,
                    segment=None if one.position is None else one.position.segment,
                    share=None if one.position is None else one.position.share,
                    orders=held[one.id],
                )
                for one in tracker.silent(self._clock())
            ),
            tracker.counts(),
            tuple(
                name
                for name, one in tracker.vehicles.items()
                if held[name] and not one.has_telemetry
            ),
        )

    def read_soon(self, read: Callable[[FleetTracker], T]) -> T | None:
        """As `read`; None while a cycle is being stored."""
        if not self._lock.acquire(timeout=_COPY_WITHIN_S):
            return None
        try:
            return read(self._tracker)
        finally:
            self._lock.release()

    def _receive(
        self,
        model: type[VehicleReport],
        key_of: Callable[[str], str],
        key: str,
        payload: bytes,
    ) -> None:
        try:
            report = decode(model, payload, key)
            if key_of(report.vehicle) != key:
                raise InputError(key, "not the vehicle of its key", "check the sender")
            self.take(report, key)
            if isinstance(report, VehiclePosition) and self.knows(report.vehicle):
                self._on_bus[report.vehicle] = self._clock()
        except InputError as error:
            self._refuse(error)
