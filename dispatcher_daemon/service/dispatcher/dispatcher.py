"""Cycles of the running dispatcher, one at a time, and what they have in common."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Collection
from concurrent.futures import Executor

from dispatcher_daemon.fleet import Fleet, FleetFile
from dispatcher_daemon.forms import routing_problem
from dispatcher_daemon.service.dispatcher.control import Control
from dispatcher_daemon.service.dispatcher.delivery import PlanDelivery
from dispatcher_daemon.service.dispatcher.health import HealthPublisher
from dispatcher_daemon.service.dispatcher.publishing import Announce, MessageBus, announce_nothing
from dispatcher_daemon.service.dispatcher.receiver import StateReceiver
from dispatcher_daemon.service.dispatcher.reports import error_text, failed_report
from dispatcher_daemon.service.dispatcher.runner import CycleRunner, Surroundings
from dispatcher_daemon.service.feeds.publisher import Feeds
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.service.store import CyclePruner
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.quantum.hardware import JobManager
from dispatcher_daemon.solvers.workers import Solve
from slipstream.orders import FleetRecords
from slipstream.roads import RoadNetwork
from slipstream.service import LogLimiter
from slipstream.service.tracing import span
from storage import Database

log = logging.getLogger(__name__)


class Dispatcher:
    """The running dispatcher. The bus's thread delivers states, the scheduler's runs cycles.

    Args:
        fleet: what is dispatched; None: nothing until `fleet_file` has a fleet.
        job_manager: of a quantum device, which then solves in place of the pool.
        fleet_file: the fleet of each cycle is read from it; None: it is always `fleet`.

    Attributes:
        cycle_began: monotonic time at which the cycle that runs began; None: none runs.
    """

    def __init__(
        self,
        settings: DispatcherSettings,
        network: RoadNetwork,
        fleet: Fleet | None,
        bus: MessageBus,
        store: Database,
        solve: Solve,
        executor: Executor | None = None,
        job_manager: JobManager | None = None,
        fleet_file: FleetFile | None = None,
        records: FleetRecords | None = None,
        announce: Announce = announce_nothing,
    ) -> None:
        started_ns = time.time_ns()
        self._settings, self._store, self._job_manager = settings, store, job_manager
        self.pruner = CyclePruner(store, settings.keep_days, settings.keep_mb)
        self._limiter = LogLimiter()
        self._turn = threading.Lock()
        self.cycle_began: float | None = None
        self.control = Control(store)
        self.receiver = StateReceiver(network, settings, announce)
        self.feeds = Feeds(
            network,
            settings,
            self.receiver.latest.latest,
            self.receiver.healths,
            counts=self.receiver.counts,
        )
        self.fleet_watch = FleetWatch(
            network,
            records or FleetRecords(),
            started_ns,
            time.time_ns,
            self.receiver.refuse,
            settings.orders.plan_ahead_s,
            settings.orders.bundle_s,
        )
        self.fleet_watch.fleet = fleet
        self.delivery = PlanDelivery(bus, store, self.fleet_watch, announce)
        self._runner = CycleRunner(
            settings,
            self.fleet_watch,
            self.delivery,
            Surroundings(
                (lambda _: fleet) if fleet_file is None else fleet_file.current,
                self.receiver.snapshot,
                lambda fleet: routing_problem(network, fleet, settings),
                solve if job_manager is None else job_manager,
                executor,
            ),
        )
        self.health = HealthPublisher(
            bus,
            settings,
            self.receiver,
            self.fleet_watch,
            self.delivery,
            job_manager,
            started_ns,
            self.control,
        )

    def run_cycle(self) -> None:
        """One cycle: snapshot, solve, store, publish. Errors end the cycle, not the dispatcher.
        While it is paused only what was reported meanwhile is stored.
        """
        with self._turn:
            if self.control.paused is None:
                self._run_one_cycle()
            else:
                self._store_reports()

    def insert(self, orders: Collection[str]) -> None:
        """Put new orders into tours that have not begun, as soon as no cycle runs; while it is
        paused they wait.
        """
        with self._turn:
            if self.control.paused is None:
                self._runner.insert(orders, time.time_ns())

    def _store_reports(self) -> None:
        now_ns = time.time_ns()
        self.fleet_watch.count_drives()
        self.delivery.store_fleet(now_ns)
        self.receiver.store_rollups(self._store, now_ns)
        self.pruner.after_cycle(now_ns)
        self._recover()

    def _recover(self) -> None:
        """Use the database that is there now, after a fault of the one before."""
        if not self.delivery.storage_fault:
            return
        self.delivery.recover()
        if not self.delivery.storage_fault:
            self.control.store_pause()

    def _run_one_cycle(self) -> None:
        number, self.cycle_began = self.delivery.next_number, time.monotonic()
        try:
            with span("cycle", cycle=number):
                self._run_cycle()
        except Exception as error:
            self.delivery.count_lost()
            self.delivery.last = failed_report(number, time.time_ns(), 0.0, error_text(error))
            if self._limiter.allow("lost"):
                log.exception("cycle %d is lost: %s", number, error)
        finally:
            self.cycle_began = None
        # After the cycle, as the check of a large database takes longer than one may.
        self._recover()

    def _run_cycle(self) -> None:
        now_ns = time.time_ns()
        if self._job_manager is not None:
            self._job_manager.begin_cycle(self.delivery.next_number)
        outcome = self._runner.run(now_ns)
        if outcome.abandoned:
            return
        # Also after a cycle that could not be stored, which bounds what waits.
        self.receiver.store_rollups(self._store, now_ns)
        if outcome.stored is not None:
            self.delivery.count(outcome.stored)
            self.pruner.after_cycle(now_ns)

    def is_live(self, next_cycle_ns: int | None) -> bool:
        """False if a cycle hangs or none is scheduled; the condition for feeding the watchdog."""
        began, settings = self.cycle_began, self._settings
        if began is not None:
            return time.monotonic() - began < settings.deadline_s + 60.0
        if next_cycle_ns is None:
            return False
        return abs(time.time_ns() - next_cycle_ns) < 2e9 * settings.interval_s
