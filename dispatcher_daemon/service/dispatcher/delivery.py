"""The end of a cycle: its plans stored with its report, then sent; and what counts cycles."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet.tracking import FleetTracker
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.service.dispatcher.publishing import (
    Announce,
    MessageBus,
    MessagePublisher,
    announce_nothing,
)
from dispatcher_daemon.service.dispatcher.reports import error_text, failed_report
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.service.store import PlanStore
from slipstream.energy.ledger import PlanEnergy
from slipstream.messages import CYCLE_KEY, CycleReport, SegmentState, VehiclePlan, plan_key
from slipstream.orders import FleetRecords
from slipstream.service import LogLimiter
from slipstream.service.tracing import note, traced
from storage import CycleInputs, OwnedError

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PlannedCycle:
    """What a cycle has planned, to be stored and sent.

    Attributes:
        plans: some may not fit any more.
    """

    report: CycleReport
    states: tuple[SegmentState, ...] = ()
    plans: tuple[VehiclePlan, ...] = ()
    problem: RoutingProblem | None = None
    energies: Mapping[str, PlanEnergy] = field(default_factory=dict)
    made_from: CycleInputs | None = None


class PlanDelivery:
    """Stores cycles and sends their plans.

    Attributes:
        failed: of the cycles since the start, stored or not.
        unanswered: cycles in a row that asked solvers, of which each died, raised or hung.
        storage_fault: the database may have to be opened anew.
        unstored: why nothing has been stored since the last cycle that was; None: it was the last.
        replaced: another dispatcher writes the database by now; None: none does.
        stopping: set once no cycle may be stored any more.
    """

    def __init__(
        self,
        bus: MessageBus,
        store: PlanStore,
        fleet_watch: FleetWatch,
        announce: Announce = announce_nothing,
    ) -> None:
        self._bus, self._store = bus, store
        self._fleet_watch, self._announce = fleet_watch, announce
        # Declared with a vehicle's first plan: a router takes half a minute to learn of 2,000
        # caches and minutes for 4,000, and passes little on meanwhile.
        self._plan_publishers: dict[str, MessagePublisher] = {}
        self._cycle_publisher = bus.publisher(CYCLE_KEY)
        self._limiter = LogLimiter()
        self.next_number = store.next_cycle_number()
        self.cycles = 0
        self.failed = 0
        self.unanswered = 0
        self.last: CycleReport | None = None
        self.storage_fault = False
        self.unstored: str | None = None
        self.replaced: OwnedError | None = None
        self.stopping = threading.Event()

    def store_and_send(self, planned: PlannedCycle, reference_s: float) -> CycleReport | None:
        """Store plans with their report, then send them.

        Args:
            planned: by a cycle, or between two.
            reference_s: from its start to the moment that the fleet's times count from.

        Returns:
            The report as stored; None: it could not be stored.
        """
        report, energies = planned.report, planned.energies

        def save(admitted: tuple[VehiclePlan, ...], records: FleetRecords) -> None:
            told = report.model_copy(update={"plans": len(admitted)})
            made_from = planned.made_from
            self._store.record_cycle(told, admitted, planned.states, records, made_from, energies)
            # Under the fleet's lock, so that nobody is told of a later change before.
            for change in records.changes:
                self._announce("order", change)

        stops = {} if planned.problem is None else planned.problem.fleet.stop_by_id
        try:
            reference_ns = report.started_ns + round(1e9 * reference_s)
            plans = self._fleet_watch.store(planned.plans, stops, reference_ns, save, energies)
        except Exception as error:
            self._report_storage_fault(report, error)
            return None
        report = report.model_copy(update={"plans": len(plans)})
        note(status=report.status, plans=len(plans))
        self._send(report, plans)
        return report

    @traced("publish")
    def _send(self, report: CycleReport, plans: tuple[VehiclePlan, ...]) -> None:
        for plan in plans:
            self._publisher_of(plan.vehicle).put(plan)
        self._cycle_publisher.put(report)
        for plan in plans:
            self._announce("plan", plan)
        self._announce("cycle", report)

    def _publisher_of(self, vehicle: str) -> MessagePublisher:
        if vehicle not in self._plan_publishers:
            self._plan_publishers[vehicle] = self._bus.publisher(plan_key(vehicle))
        return self._plan_publishers[vehicle]

    def store_fleet(self, now_ns: int) -> None:
        """Store what vehicles have reported beside a cycle."""

        def save(_plans: tuple[VehiclePlan, ...], records: FleetRecords) -> None:
            self._store.save_fleet(records)
            for change in records.changes:
                self._announce("order", change)

        try:
            self._fleet_watch.store((), {}, now_ns, save)
            self.unstored = None
        except Exception as error:
            self.unstored = f"what vehicles reported is not stored: {error_text(error)}"
            self.storage_fault = True
            self._limiter.warn(log, "fleet", self.unstored)

    def _report_storage_fault(self, report: CycleReport, error: Exception) -> None:
        """Publish a failed report for a cycle that could not be stored; its plans are not sent."""
        reason = f"not stored, so no plan was sent: {error_text(error)}"
        self._limiter.warn(log, "storage", f"cycle {report.cycle} {reason}")
        self.storage_fault, self.unstored = True, reason
        self.count_lost()
        self.last = failed_report(report.cycle, report.started_ns, report.wall_s, reason)
        self._cycle_publisher.put(self.last)

    def recover(self) -> None:
        """Open the database anew if it was replaced; numbers go on above all stored ones."""
        try:
            self.next_number = max(self.next_number, self._store.next_cycle_number())
            self.storage_fault = False
            self._fleet_watch.read(FleetTracker.mark_all)
        except OwnedError as error:
            # Its orders and plans would be overwritten by what was known before.
            self.replaced = error
            self.stopping.set()
        except Exception as error:
            self._limiter.warn(log, "recovery", f"the database cannot be used yet: {error}")

    def count_lost(self) -> None:
        """Count a cycle that was not stored."""
        self.failed += 1
        metrics.CYCLES.labels("lost").inc()

    def count(self, report: CycleReport) -> None:
        """Count a stored cycle."""
        self.last, self.unstored = report, None
        self.cycles += 1
        self.failed += report.status == "failed"
        if report.solvers:
            mute = all(run.status in ("failed", "timeout") for run in report.solvers)
            self.unanswered = self.unanswered + 1 if mute else 0
        metrics.count_cycle(report)
        saved = "no energy figures"
        if report.energy is not None:
            energy = report.energy
            saved = f"{energy.cooperative_kwh:.3f} kWh against {energy.baseline_kwh:.3f}"
        log.info(
            "cycle %d %s: %d plans by %s, %s, %.2f s%s",
            report.cycle,
            report.status,
            report.plans,
            report.solver,
            saved,
            report.wall_s,
            f" ({report.reason})" if report.reason else "",
        )
