"""Cycles of the running dispatcher, one at a time, and what they have in common."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Collection, Mapping
from concurrent.futures import Executor

from dispatcher_daemon import metrics
from dispatcher_daemon.fleet import Fleet, FleetFile
from dispatcher_daemon.fleet.tracking import HIDDEN, Situation
from dispatcher_daemon.forms import RoutingProblem, routing_problem
from dispatcher_daemon.planning.cycle import CycleResult, cycle_seed, run_cycle
from dispatcher_daemon.planning.plans import Cycle
from dispatcher_daemon.planning.replay import InputEncoder, Recorder
from dispatcher_daemon.planning.route_form import NO_VEHICLE
from dispatcher_daemon.service.dispatcher.control import Control
from dispatcher_daemon.service.dispatcher.delivery import PlanDelivery
from dispatcher_daemon.service.dispatcher.health import HealthPublisher
from dispatcher_daemon.service.dispatcher.insertion import OrderInsertion
from dispatcher_daemon.service.dispatcher.publishing import Announce, MessageBus, announce_nothing
from dispatcher_daemon.service.dispatcher.receiver import StateReceiver
from dispatcher_daemon.service.dispatcher.reports import error_text, failed_report, idle_report
from dispatcher_daemon.service.feeds.publisher import Feeds
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.service.store import CyclePruner, CycleStore
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.solvers.quantum.hardware import JobManager
from dispatcher_daemon.solvers.workers import Solve
from slipstream.energy_ledger import PlanEnergy
from slipstream.errors import InputError
from slipstream.messages import SegmentState, Unserved, VehiclePlan
from slipstream.orders import FleetRecords
from slipstream.roads import RoadNetwork
from slipstream.service import LogLimiter
from slipstream.tracing import span
from storage import CycleInputs

log = logging.getLogger(__name__)


def _explained(one: Unserved, situation: Situation) -> Unserved:
    """A stop without a vehicle, with what keeps all vehicles."""
    why = situation.nobody if one.reason == NO_VEHICLE else one.reason
    return one.model_copy(update={"reason": why})


class Dispatcher:
    """The running dispatcher. The bus's thread delivers states, the scheduler's runs cycles.

    Args:
        settings: checked settings.
        network: roads.
        fleet: what is dispatched; None: nothing until `fleet_file` has a fleet.
        bus: to publish through.
        store: database.
        solve: solver pool.
        executor: for the search of the route form's base routes; None: the cycle's own thread.
        job_manager: of a quantum device, which then solves in place of the pool.
        fleet_file: the fleet of each cycle is read from it; None: it is always `fleet`.
        records: orders, plans and vehicles of the run before.
        announce: told of accepted states, and of what was stored; it does not wait.

    Attributes:
        control: what operators do.
        receiver: takes in segment states.
        fleet_watch: the tracked fleet.
        delivery: stores and sends plans, and counts cycles.
        health: what the dispatcher says of itself.
        feeds: for road authorities.
        pruner: deletes what is old or too much.
        cycle_began: monotonic time at which the cycle that runs began; None: none runs.
    """

    def __init__(
        self,
        settings: DispatcherSettings,
        network: RoadNetwork,
        fleet: Fleet | None,
        bus: MessageBus,
        store: CycleStore,
        solve: Solve,
        executor: Executor | None = None,
        job_manager: JobManager | None = None,
        fleet_file: FleetFile | None = None,
        records: FleetRecords | None = None,
        announce: Announce = announce_nothing,
    ) -> None:
        started_ns = time.time_ns()
        self._settings, self._network, self._store = settings, network, store
        self._solve = solve if job_manager is None else job_manager
        self._executor, self._job_manager = executor, job_manager
        self._fleet, self._fleet_file = fleet, fleet_file
        self._problem: RoutingProblem | None = None
        self._stops: Mapping[str, tuple[str, ...]] = {}
        self._inputs = InputEncoder()
        self.pruner = CyclePruner(store, settings.keep_days, settings.keep_mb)
        self._limiter = LogLimiter()
        self._turn = threading.Lock()
        self.cycle_began: float | None = None
        self.control = Control(store)
        self.receiver = StateReceiver(network, settings, announce)
        self.feeds = Feeds(network, settings, self.receiver.latest.latest)
        self.fleet_watch = FleetWatch(
            network,
            records or FleetRecords(),
            started_ns,
            time.time_ns,
            self.receiver.refuse,
            settings.orders.plan_ahead_s,
        )
        self.fleet_watch.fleet = fleet
        self.delivery = PlanDelivery(bus, store, self.fleet_watch, announce)
        self._insertion = OrderInsertion(
            settings, network, self.fleet_watch, self.receiver, self.delivery, self._inputs
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
                self._insertion.insert(orders)

    def _store_reports(self) -> None:
        now_ns = time.time_ns()
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
        number, began, now_ns = self.delivery.next_number, time.monotonic(), time.time_ns()
        plans: tuple[VehiclePlan, ...] = ()
        energies: Mapping[str, PlanEnergy] = {}
        states: tuple[SegmentState, ...] = ()
        problem: RoutingProblem | None = None
        made_from: CycleInputs | None = None
        reference_s = self._settings.deadline_s
        if self._job_manager is not None:
            self._job_manager.begin_cycle(number)
        try:
            snapshot = self.fleet_watch.expected(self.receiver.snapshot(now_ns))
            states = snapshot.states
            metrics.GATES_OPEN.set(sum(gate.open for gate in snapshot.gates()))
            situation = self._situation(number, now_ns, reference_s)
            problem = self._problem_of(situation.fleet)
            if problem is None:
                report = idle_report(
                    number, now_ns, time.monotonic() - began, snapshot, situation.waiting
                )
            else:
                cycle = Cycle(
                    problem,
                    snapshot,
                    self._settings,
                    number,
                    now_ns,
                    cycle_seed(self._settings.seed, number),
                    start=self._stops or None,
                    commitments=situation.commitments,
                    on_road=situation.on_road,
                )
                with Recorder(self._solve, self._executor) as recorder:
                    result = run_cycle(cycle, recorder.solve, recorder.executor, recorder.clock)
                report, plans, energies = result.report, result.plans, result.energies
                unserved = tuple(_explained(one, situation) for one in report.unserved)
                report = report.model_copy(update={"unserved": unserved})
                self.fleet_watch.note_unserved({u.stop: u.reason for u in unserved})
                self._stops = result.stops
                made_from = self._made_from(cycle, recorder, result)
            kept_back = [*((stop, HIDDEN) for stop in situation.hidden), *situation.waiting.items()]
            others = tuple(Unserved(stop=stop, reason=reason) for stop, reason in kept_back)
            report = report.model_copy(update={"unserved": (*others, *report.unserved)})
        except InputError as error:
            self._limiter.warn(log, "input", f"cycle {number} failed: {error}")
            report = failed_report(number, now_ns, time.monotonic() - began, str(error)[:500])
        except Exception as error:
            log.exception("cycle %d failed", number)
            report = failed_report(number, now_ns, time.monotonic() - began, error_text(error))
        if self.delivery.stopping.is_set():
            log.info("cycle %d abandoned: stopping", number)
            return
        self.delivery.next_number += 1
        stops = {} if problem is None else problem.fleet.stop_by_id
        stored = self.delivery.store_and_send(
            report, plans, states, stops, reference_s, energies, made_from
        )
        # Also after a cycle that could not be stored, which bounds what waits.
        self.receiver.store_rollups(self._store, now_ns)
        if stored is not None:
            self.delivery.count(stored)
            self.pruner.after_cycle(now_ns)

    def _situation(self, number: int, now_ns: int, reference_s: float) -> Situation:
        """What the cycle may plan, by the fleet's file as it is now."""
        reference_ns = now_ns + round(1e9 * reference_s)
        listed = self._fleet_file
        fleet = self._fleet if listed is None else listed.current(reference_ns)
        situation = self.fleet_watch.situation(fleet, number, now_ns, reference_s)
        if situation.hidden:
            some = ", ".join(situation.hidden[:10])
            what = f"{len(situation.hidden)} stops of the fleet's file are not planned"
            line = f"{what}, as callers' orders have their ids: {some}"
            self._limiter.warn(log, "hidden stops", line)
        return situation

    def _problem_of(self, fleet: Fleet | None) -> RoutingProblem | None:
        """The problem of a cycle's fleet; None: nothing to dispatch."""
        if fleet is None:
            return None
        if self._problem is None or fleet is not self._problem.fleet:
            self._problem = routing_problem(self._network, fleet, self._settings)
            self._stops = {}
        return self._problem

    def _made_from(
        self, cycle: Cycle, recorder: Recorder, result: CycleResult
    ) -> CycleInputs | None:
        """The inputs of a cycle, to be stored with it; a fault here does not cost its plans."""
        try:
            return self._inputs.encode(cycle, recorder.trace(), result)
        except Exception as error:
            if self._limiter.allow("inputs"):
                log.exception("the inputs of cycle %d are not stored: %s", cycle.number, error)
            return None

    def is_live(self, next_cycle_ns: int | None) -> bool:
        """False if a cycle hangs or none is scheduled; the condition for feeding the watchdog."""
        began, settings = self.cycle_began, self._settings
        if began is not None:
            return time.monotonic() - began < settings.deadline_s + 60.0
        if next_cycle_ns is None:
            return False
        return abs(time.time_ns() - next_cycle_ns) < 2e9 * settings.interval_s
